"""The systems of an SSP flattened: components by path, and which connector leads to which.

A connector is an end of a connection: of a component (there a signal starts or stops), of a system, or of a signal
dictionary (there it passes through). Connections are directed by what the connectors say of themselves, since SSP lets
start and end stand either way round.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from attrs import field, frozen

from cosim.errors import did_you_mean
from cosim.scenario.ssp_document import Element, Findings, children, first, parse, required, truth
from cosim.scenario.ssp_files import SspFiles
from cosim.scenario.ssp_fmu import FmuFace, read_face
from cosim.scenario.ssp_grammar import short
from cosim.scenario.ssp_units import Units, transformation
from cosim.signals import Linear

ElementPath = tuple[str, ...]
_FMU = "application/x-fmu-sharedlibrary"
_TO_INSIDE = ("input", "parameter")
_TO_OUTSIDE = ("output", "calculatedParameter")
_OPPOSITE = {"source": "target", "target": "source"}


@frozen
class End:
    """A connector of an element: of the system itself where the path is that of the system."""

    path: ElementPath
    connector: str


@frozen
class Passage:
    """A connection towards an end.

    converts: false where it forbids the conversion of units; change: a linear transformation beside that conversion.
    """

    end: End
    element: Element
    converts: bool = True
    change: Linear | None = None


@frozen
class SspComponent:
    """An FMU of the system: its name in the scenario, its file, what it says of its variables."""

    name: str
    element: Element
    fmu: Path
    face: FmuFace | None


@frozen
class SspTree:
    """Components, systems and connectors by path, and the connections that start at each end."""

    components: dict[ElementPath, SspComponent] = field(factory=dict)
    systems: dict[ElementPath, Element] = field(factory=dict)
    connectors: dict[End, Element] = field(factory=dict)
    passages: dict[End, list[Passage]] = field(factory=dict)
    dictionaries: dict[tuple[ElementPath, str], Element] = field(factory=dict)
    references: dict[ElementPath, ElementPath] = field(factory=dict)

    def beyond(self, start: End) -> Iterator[list[Passage]]:
        """Each way from an end to a connector of a component, through the connectors of systems and dictionaries."""
        waiting: list[list[Passage]] = [[p] for p in self.passages.get(start, ())]
        seen = {start}
        while waiting:
            way = waiting.pop(0)
            end = way[-1].end
            if end.path in self.components:
                yield way
            elif end not in seen:
                seen.add(end)
                waiting += [[*way, p] for p in self.passages.get(end, ())]

    def holders(self, path: ElementPath, name: str) -> list[tuple[ElementPath, str]]:
        """The variables of components that a hierarchical name of an element means, `B.C.P2`."""
        if path in self.components:
            face = self.components[path].face
            return [(path, name)] if face is None or name in face.variables else []
        if End(path, name) in self.connectors:
            return [(way[-1].end.path, way[-1].end.connector) for way in self.beyond(End(path, name))]
        for child in [p for p in (*self.components, *self.systems) if p[:-1] == path and len(p) == len(path) + 1]:
            if name.startswith(f"{child[-1]}."):
                found = self.holders(child, name[len(child[-1]) + 1 :])
                if found:
                    return found
        return []

    def known(self, path: ElementPath) -> list[str]:
        """Names that a parameter of an element may have."""
        if path in self.components:
            face = self.components[path].face
            return [] if face is None else list(face.variables)
        own = [end.connector for end in self.connectors if end.path == path]
        inner = [
            ".".join((*p[len(path) :], name))
            for p, c in self.components.items()
            if p[: len(path)] == path
            for name in (c.face.variables if c.face else ())
        ]
        return own + inner


def read_tree(system: Element, files: SspFiles, units: Units, findings: Findings) -> SspTree:
    """The systems below the top one, as components and connections; what cannot be read is added to the findings."""
    tree = SspTree()
    _walk(system, (), tree, files, findings)
    for path, element in tree.systems.items():
        for connection in children(element, "ssd:Connections/ssd:Connection"):
            _connect(connection, path, tree, units, findings)
    return tree


def _walk(system: Element, path: ElementPath, tree: SspTree, files: SspFiles, findings: Findings) -> None:
    tree.systems[path] = system
    _connectors(system, path, tree, findings)
    for dictionary in children(system, "ssd:SignalDictionaries/ssd:SignalDictionary"):
        _dictionary(dictionary, path, tree, files, findings)
    elements = first(system, "ssd:Elements")
    names: set[str] = set()
    for element in () if elements is None else elements:
        name = required(element, "name", findings)
        if name in names:
            findings.refuse(element, "names that differ", f"a second element {name!r}")
        names.add(name)
        kind = short(element.tag)
        if kind == "ssd:System":
            _walk(element, (*path, name), tree, files, findings)
        elif kind == "ssd:Component":
            _component(element, (*path, name), tree, files, findings)
        else:
            _reference(element, (*path, name), tree, findings)


def _connectors(element: Element, path: ElementPath, tree: SspTree, findings: Findings) -> None:
    for connector in children(element, "ssd:Connectors/ssd:Connector"):
        end = End(path, required(connector, "name", findings))
        if end in tree.connectors:
            findings.refuse(connector, "connectors of different names", f"a second {end.connector!r}")
        if required(connector, "kind", findings) not in (*_TO_INSIDE, *_TO_OUTSIDE, "inout"):
            findings.refuse(connector, "a kind of SSP 1.0", repr(connector.get("kind")))
        tree.connectors[end] = connector


def _component(element: Element, path: ElementPath, tree: SspTree, files: SspFiles, findings: Findings) -> None:
    kind, way = element.get("type", _FMU), element.get("implementation", "any")
    if kind != _FMU:
        findings.refuse(element, f"a component that is an FMU ({_FMU})", repr(kind), "put its systems into this file")
        return
    if way not in ("any", "CoSimulation"):
        findings.refuse(element, "an FMU for co-simulation", f"implementation={way!r}")
    source = required(element, "source", findings)
    found = files.find(element, source, findings) if source else None
    if found is None:
        return
    fmu = files.packed(found)
    name = _free_name(path, tree)
    if name != ".".join(path):
        findings.tell(element, f"component {'.'.join(path)!r} is called {name!r} here")
    tree.components[path] = SspComponent(name, element, fmu, read_face(fmu, files.label(found)))
    _connectors(element, path, tree, findings)


def _free_name(path: ElementPath, tree: SspTree) -> str:
    """The component's name in the scenario: letters, digits, `_` and `-`, the systems around it before it."""
    wanted = re.sub(r"[^A-Za-z0-9_-]", "_", "_".join(path))
    taken = {component.name for component in tree.components.values()}
    return next(n for n in (wanted, *(f"{wanted}_{k}" for k in range(2, len(taken) + 3))) if n not in taken)


def _dictionary(element: Element, path: ElementPath, tree: SspTree, files: SspFiles, findings: Findings) -> None:
    """The entries of a signal dictionary become connectors that a signal passes through."""
    name, inline, source = (
        required(element, "name", findings),
        first(element, "ssb:SignalDictionary"),
        element.get("source"),
    )
    if (source is None) == (inline is None):
        findings.refuse(element, "a source or a <ssb:SignalDictionary> inside", "none" if source is None else "both")
        return
    if source is not None:
        read = files.read(element, source, findings)
        inline = None if read is None else parse(*read, "ssb:SignalDictionary", findings)
    if inline is not None:
        tree.dictionaries[path, name] = inline


def _reference(element: Element, path: ElementPath, tree: SspTree, findings: Findings) -> None:
    """Connectors of a reference are the entries of the dictionary, wherever else they are referred to."""
    name = required(element, "dictionary", findings)
    owner = next((path[:n] for n in range(len(path) - 1, -1, -1) if (path[:n], name) in tree.dictionaries), None)
    if owner is None:
        findings.refuse(element, "a signal dictionary of this system or one around it", repr(name))
        return
    entries = {e.get("name") for e in children(tree.dictionaries[owner, name], "ssb:DictionaryEntry")}
    for connector in children(element, "ssd:Connectors/ssd:Connector"):
        if connector.get("name") not in entries:
            findings.refuse(connector, f"an entry of {name!r}", repr(connector.get("name")))
    tree.references[path] = (*owner, f"dictionary {name}")


def _connect(connection: Element, system: ElementPath, tree: SspTree, units: Units, findings: Findings) -> None:
    """Add a connection, directed from where a signal comes to where it goes."""
    ends, roles = [], []
    for side in ("start", "end"):
        found = _end(connection, side, system, tree, findings)
        if found is None:
            return
        ends.append(found[0])
        roles.append(found[1])
    start, stop = (role or _OPPOSITE.get(other or "", "") for role, other in (roles, roles[::-1]))
    if start == stop:
        both = f"two that {'give' if start == 'source' else 'take'} one" if start else "two that may do both"
        findings.refuse(connection, "a connector that gives a signal and one that takes it", both)
        return
    change = _change(connection, start == "source", findings)
    converts = not truth(connection, "suppressUnitConversion", findings, False)
    source, target = ends if start == "source" else ends[::-1]
    tree.passages.setdefault(source, []).append(Passage(target, connection, converts, change))


def _change(connection: Element, forward: bool, findings: Findings) -> Linear | None:
    """The linear transformation of a connection; other ones are refused, and one that points against the signal."""
    found = [child for child in connection if short(child.tag).endswith("Transformation")]
    if not found:
        return None
    name = short(found[0].tag)
    if len(found) > 1 or name != "ssc:LinearTransformation":
        got = f"{len(found)} of them" if len(found) > 1 else f"<{name}>"
        findings.refuse(found[0], "one linear transformation", got, "transform in a component")
        return None
    change = transformation(found[0], findings)
    if not forward and change != Linear():
        findings.refuse(found[0], "a transformation from the start to the end", "a signal that goes from end to start")
    return change


def _end(
    connection: Element, side: str, system: ElementPath, tree: SspTree, findings: Findings
) -> tuple[End, str | None] | None:
    """One end of a connection and whether it is the source or the target of the signal there (None: it may be both)."""
    element, connector = connection.get(f"{side}Element"), required(connection, f"{side}Connector", findings)
    if not element:  # OMSimulator writes an empty one where the standard leaves it out
        return _own(connection, End(system, connector), tree, findings)
    path = (*system, element)
    if path in tree.references:
        return End(tree.references[path], connector), None
    if path not in tree.components and path not in tree.systems:
        if not _is_refused(path, tree):
            known = [p[-1] for p in (*tree.components, *tree.systems, *tree.references) if p[:-1] == system and p]
            findings.refuse(connection, "an element of this system", repr(element), did_you_mean(element, known))
        return None
    end = End(path, connector)
    kind = _kind(end, tree)
    if kind is None:
        known = [e.connector for e in tree.connectors if e.path == path]
        findings.refuse(
            connection,
            f"a connector of {element!r}",
            repr(connector),
            did_you_mean(connector, known + tree.known(path)),
        )
        return None
    return end, "source" if kind in _TO_OUTSIDE else "target" if kind in _TO_INSIDE else None


def _is_refused(path: ElementPath, tree: SspTree) -> bool:
    """Whether there is such an element, whose own problem has been told."""
    system = tree.systems[path[:-1]]
    elements = first(system, "ssd:Elements")
    return elements is not None and any(element.get("name") == path[-1] for element in elements)


def _own(connection: Element, end: End, tree: SspTree, findings: Findings) -> tuple[End, str | None] | None:
    """A connector of the system itself, seen from inside."""
    if end not in tree.connectors:
        known = [e.connector for e in tree.connectors if e.path == end.path]
        findings.refuse(
            connection, "a connector of this system", repr(end.connector), did_you_mean(end.connector, known)
        )
        return None
    kind = tree.connectors[end].get("kind")
    return end, "source" if kind in _TO_INSIDE else "target" if kind in _TO_OUTSIDE else None


def _kind(end: End, tree: SspTree) -> str | None:
    """What a connector says of itself, or the FMU says of its variable; None where neither knows it."""
    if end in tree.connectors:
        return tree.connectors[end].get("kind")
    component = tree.components.get(end.path)
    if component is None:
        return None
    if component.face is None:
        return "inout"
    variable = component.face.variables.get(end.connector)
    return None if variable is None else variable.causality


def starts(tree: SspTree) -> Mapping[End, list[list[Passage]]]:
    """The ways of every signal that a component gives, by its connector."""
    return {end: list(tree.beyond(end)) for end in tree.passages if end.path in tree.components}
