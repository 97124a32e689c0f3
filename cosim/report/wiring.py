"""Block diagram of a wiring, drawn as SVG with an automatic layout.

With two arms the way from local to remote is the top row, left to right, and the way back the bottom row; the arms span
both. What drives only one arm stands outside of it, the rest in between. Without arms the components stand in layers.
"""

from collections.abc import Iterable, Mapping
from html import escape

from attrs import field, frozen

from cosim.signals import stem
from cosim.wiring import Hop, Wiring

_WIDTH, _HEIGHT, _GAP_X, _GAP_Y, _MARGIN = 148, 82, 124, 34, 14
_LINE, _INK, _SOFT, _FILL = "var(--grey)", "var(--ink)", "var(--soft)", "var(--wash)"
_ACCENT = {
    "PhantomArm": "#0072B2",
    "VariableDelayChannel": "#E69F00",
    "PacketChannel": "#E69F00",
    "Controller": "#009E73",
    "Operator": "#CC79A7",
    "Environment": "#D55E00",
}


@frozen
class Box:
    """A component at a place of the grid: column, first row, rows spanned."""

    name: str
    column: float
    row: float
    span: int = 1

    @property
    def left(self) -> float:
        return _MARGIN + self.column * (_WIDTH + _GAP_X)

    @property
    def right(self) -> float:
        return self.left + _WIDTH

    @property
    def top(self) -> float:
        return _MARGIN + self.row * (_HEIGHT + _GAP_Y)

    @property
    def bottom(self) -> float:
        return self.top + self.span * _HEIGHT + (self.span - 1) * _GAP_Y

    @property
    def middle(self) -> tuple[float, float]:
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2


@frozen
class Wire:
    """All connections from one component to another: their labels and the age that they add [s]."""

    source: str
    target: str
    labels: tuple[str, ...] = field(converter=tuple)
    age: float = 0.0


def block_diagram(wiring: Wiring) -> str:
    """The wiring as an inline `<svg>`: components with model and key values, connections with names and added delay."""
    boxes = {box.name: box for box in place(wiring)}
    wires = _wires(wiring.hops)
    parts = [_draw_wire(wire, boxes, lane) for wire, lane in _lanes(wires, boxes)]
    parts += [_draw_box(box, wiring) for box in boxes.values()]
    width = max(box.right for box in boxes.values()) + _MARGIN
    height = max(box.bottom for box in boxes.values()) + _MARGIN + 18
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'style="width:{width:g}px;max-width:100%;'
        f'height:auto" role="img" aria-label="block diagram" '
        f'font-family="DejaVu Sans, sans-serif">{_MARKER}{"".join(parts)}</svg>'
    )


_MARKER = (
    '<defs><marker id="wiring-tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    f'<path d="M0,0.8 L7.4,4 L0,7.2 z" fill="{_LINE}"/></marker></defs>'
)


# --- layout
# ------------------------------------------------------------------------------------------------------------


def place(wiring: Wiring) -> list[Box]:
    """Boxes of all components on the grid, no two at the same place."""
    neighbours = _neighbours(wiring)
    arms = wiring.scenario.arms
    if arms is None or not (wiring.lr or wiring.rl):
        return _layers(wiring)
    ring = _ring(wiring, arms)
    rest = [name for name in wiring.scenario.components if name not in ring]
    boxes = dict(ring)
    for name in rest:
        boxes[name] = _beside(name, neighbours[name], boxes, arms)
    shift = -min(box.column for box in boxes.values())
    lift = -min(box.row for box in boxes.values())
    return [Box(b.name, b.column + shift, b.row + lift, b.span) for b in boxes.values()]


def _ring(wiring: Wiring, arms: tuple[str, str]) -> dict[str, Box]:
    """Arms at the ends, the components of the way there on top, of the way back below."""
    local, remote = arms
    there = list(wiring.lr[0].components[1:-1] if wiring.lr else ())
    back = [name for name in (wiring.rl[0].components[1:-1] if wiring.rl else ()) if name not in there]
    columns = max(len(there), len(back), 1)
    boxes = {local: Box(local, 0, 0, 3), remote: Box(remote, columns + 1, 0, 3)}
    for names, row in ((there, 0), (back[::-1], 2)):
        for i, name in enumerate(names):
            boxes[name] = Box(name, 1 + i + (columns - len(names)) / 2, row)
    return boxes


def _beside(name: str, near: set[str], boxes: Mapping[str, Box], arms: tuple[str, str]) -> Box:
    """A free place outside the arm that the component belongs to, else between the rows."""
    local, remote = arms
    placed = [boxes[n] for n in near if n in boxes]
    if local in near and remote not in near:
        wanted = (-1.0, 1.0)
    elif remote in near and local not in near:
        wanted = (boxes[remote].column + 1.0, 1.0)
    else:
        wanted = (sum(b.column for b in placed) / len(placed) if placed else 0.0, 1.0 if placed else 3.0)
    column, row = wanted
    for candidate in (row, 0.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0):
        if _free(column, candidate, boxes.values()):
            return Box(name, column, candidate)
    return Box(name, column, 8.0 + len(boxes))


def _free(column: float, row: float, boxes: Iterable[Box]) -> bool:
    return not any(abs(b.column - column) < 1 and row > b.row - 1 and row < b.row + b.span for b in boxes)


def _neighbours(wiring: Wiring) -> dict[str, set[str]]:
    near: dict[str, set[str]] = {name: set() for name in wiring.scenario.components}
    for hop in wiring.hops:
        a, b = hop.connection.source.component, hop.connection.target.component
        near[a].add(b)
        near[b].add(a)
    return near


def _layers(wiring: Wiring) -> list[Box]:
    """Components in columns by their distance from the sources; ways back are left out."""
    forward: dict[str, list[str]] = {name: [] for name in wiring.scenario.components}
    for hop in wiring.hops:
        forward[hop.connection.source.component].append(hop.connection.target.component)
    driven = {t for targets in forward.values() for t in targets}
    starts = [n for n in forward if n not in driven] or list(forward)[:1]
    layer: dict[str, int] = dict.fromkeys(starts, 0)
    queue = list(starts)
    while queue:
        name = queue.pop(0)
        for target in forward[name]:
            if target not in layer:
                layer[target] = layer[name] + 1
                queue.append(target)
    for name in forward:
        layer.setdefault(name, 0)
    rows: dict[int, int] = {}
    boxes = []
    for name, column in layer.items():
        boxes.append(Box(name, column, rows.get(column, 0) * 1.2))
        rows[column] = rows.get(column, 0) + 1
    return boxes


# --- drawing
# -----------------------------------------------------------------------------------------------------------


def _wires(hops: Iterable[Hop]) -> list[Wire]:
    """One wire for all connections between the same two components."""
    found: dict[tuple[str, str], list[Hop]] = {}
    for hop in hops:
        found.setdefault((hop.connection.source.component, hop.connection.target.component), []).append(hop)
    return [
        Wire(a, b, [_label(hop) for hop in group], max(hop.age for hop in group)) for (a, b), group in found.items()
    ]


def _label(hop: Hop) -> str:
    source, target = stem(hop.connection.source.variable), stem(hop.connection.target.variable)
    return source if source == target else f"{source} → {target}"


def _lanes(wires: list[Wire], boxes: Mapping[str, Box]) -> list[tuple[Wire, float]]:
    """Each wire with its offset across the way [px], so that wires between the same boxes run side by side."""
    placed = []
    for wire in wires:
        between = [w for w in wires if {w.source, w.target} == {wire.source, wire.target}]
        placed.append((wire, (between.index(wire) - (len(between) - 1) / 2) * 26))
    return placed


def _draw_wire(wire: Wire, boxes: Mapping[str, Box], lane: float) -> str:
    a, b = boxes[wire.source], boxes[wire.target]
    if a.right < b.left or b.right < a.left:
        return _sideways(wire, a, b, lane)
    return _upright(wire, a, b, lane)


def _sideways(wire: Wire, a: Box, b: Box, lane: float) -> str:
    """A wire between boxes in different columns, from side to side."""
    rightwards = a.right < b.left
    x0, x1 = (a.right, b.left) if rightwards else (a.left, b.right)
    y = _common(a, b)
    y0, y1 = (a.middle[1], b.middle[1]) if y is None else (y, y)
    y0, y1 = y0 + lane, y1 + lane
    bend = (x1 - x0) / 2
    path = (
        f"M{x0:g},{y0:g} L{x1:g},{y1:g}"
        if y0 == y1
        else f"M{x0:g},{y0:g} C{x0 + bend:g},{y0:g} {x1 - bend:g},{y1:g} {x1:g},{y1:g}"
    )
    return _line(path) + _text(wire, (x0 + x1) / 2, (y0 + y1) / 2 - 5, "middle")


def _upright(wire: Wire, a: Box, b: Box, lane: float) -> str:
    """A wire between boxes of overlapping columns, from edge to edge."""
    down = a.bottom <= b.top
    y0, y1 = (a.bottom, b.top) if down else (a.top, b.bottom)
    x0 = min(max(b.middle[0], a.left + 16), a.right - 16) + lane
    x1 = min(max(a.middle[0], b.left + 16), b.right - 16) + lane
    x0 = x1 = (x0 + x1) / 2
    return _line(f"M{x0:g},{y0:g} L{x1:g},{y1:g}") + _text(wire, x0 + 7, (y0 + y1) / 2 + 3, "start")


def _common(a: Box, b: Box) -> float | None:
    """A height that both boxes have, near the middle of the smaller one."""
    low, high = max(a.top, b.top) + 12, min(a.bottom, b.bottom) - 12
    if low > high:
        return None
    small = a if a.span <= b.span else b
    return min(max(small.middle[1], low), high)


def _line(path: str) -> str:
    return f'<path d="{path}" fill="none" stroke="{_LINE}" stroke-width="1.3" marker-end="url(#wiring-tip)"/>'


def _text(wire: Wire, x: float, y: float, anchor: str) -> str:
    """Names above the wire; below it what the master's stepping adds."""
    names = ", ".join(dict.fromkeys(wire.labels))
    if len(names) > 18:
        names = ", ".join(dict.fromkeys(label.partition(" →")[0] for label in wire.labels))
    names = names if len(names) <= 18 else names[:17] + "…"
    style = f'text-anchor="{anchor}" font-size="10.5" paint-order="stroke" stroke="var(--paper)" stroke-width="3"'
    full = f"<title>{escape(f'{wire.source} to {wire.target}: ' + ', '.join(wire.labels))}</title>"
    text = f'<text x="{x:g}" y="{y:g}" {style} fill="{_INK}">{full}{escape(names)}</text>'
    if wire.age:
        text += f'<text x="{x:g}" y="{y + 16:g}" {style} fill="{_SOFT}">{escape(milliseconds(wire.age))}</text>'
    return text


def milliseconds(age: float) -> str:
    """An age [s] as text in milliseconds, with its sign."""
    return f"{age * 1e3:+.3g} ms".replace("-", "−")


def _draw_box(box: Box, wiring: Wiring) -> str:
    component = wiring.scenario.components[box.name]
    model = wiring.descriptions[box.name].model
    colour = _ACCENT.get("Controller" if model.endswith("Controller") else model, "#8a8f98")
    x, y, height = box.left, box.top, box.bottom - box.top
    lines = _facts(wiring, box.name)
    middle = y + height / 2 - 8 * (len(lines) + 1)
    text = [
        f'<text x="{x + 14:g}" y="{middle + 12:g}" font-size="13" font-weight="600" fill="{_INK}">'
        f"{escape(box.name)}</text>"
    ]
    text += [
        f'<text x="{x + 14:g}" y="{middle + 12 + 16 * (i + 1):g}" font-size="10.5" fill="{_SOFT}">{escape(line)}</text>'
        for i, line in enumerate(lines)
    ]
    return (
        f"<g><title>{escape(box.name)}: {escape(component.kind)}</title>"
        f'<rect x="{x:g}" y="{y:g}" width="{_WIDTH}" height="{height:g}" rx="6" '
        f'fill="{_FILL}" stroke="var(--edge)"/>'
        f'<rect x="{x:g}" y="{y:g}" width="5" height="{height:g}" rx="2.5" fill="{colour}"/>{"".join(text)}</g>'
    )


def _facts(wiring: Wiring, name: str) -> list[str]:
    """Model and up to three lines of key values of a component."""
    component, starts = wiring.scenario.components[name], wiring.starts[name]
    facts = [wiring.descriptions[name].model]
    if component.parameter_set:
        facts.append(f"set {component.parameter_set}")
    description = wiring.descriptions[name]
    for symbol, key in _GAINS:
        axes = [axis for axis in description.elements(key) if axis in starts]
        values = [f"{starts[axis]:g}" for axis in axes]
        if any(starts[axis] for axis in axes):
            unit = description.variables[axes[0]].unit.name.replace(".", "·")
            facts.append(f"{symbol} {', '.join(values if len(set(values)) > 1 else values[:1])} {unit}")
    law = description.variables.get("law")
    if law is not None and "law" in starts:
        facts.append(_delay(law.item(starts["law"]), starts))
    if component.step_multiple > 1:
        facts.append(f"every {component.step_multiple} steps")
    return [fact if len(fact) <= 22 else fact[:21] + "…" for fact in facts[:4]]


_GAINS = [
    (symbol, f"{space}{name}") for space in ("", "joint_") for symbol, name in (("K", "stiffness"), ("B", "damping"))
]


def _delay(law: str, starts: Mapping[str, object]) -> str:
    if law == "constant":
        return f"{starts.get('delay_mean', 0):g} s"
    if law == "recorded":
        return "recorded delay"
    return f"{law} {starts.get('delay_min', 0):g}–{starts.get('delay_max', 0):g} s"
