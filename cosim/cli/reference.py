"""The manual's reference, generated from the code: keys of files, commands, the public API, FMUs, effects."""

import ast
import inspect
import textwrap
from collections.abc import Iterable, Mapping
from enum import Enum
from itertools import pairwise
from types import UnionType
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin

from cosim.report.manual import ManualPage

if TYPE_CHECKING:
    from attrs import Attribute
    from typer.core import TyperCommand


def reference_pages() -> tuple[ManualPage, ...]:
    """Every page that is generated."""
    return (scenario_page(), sweep_page(), commands_page(), api_page(), effects_page(), *model_pages())


def scenario_page() -> ManualPage:
    """Keys of a scenario's TOML file."""
    from cosim.scenario.parts import Component, Conversion, Experiment, Teleoperation

    wishes = ", ".join(f"`{wish.value}`" for wish in Conversion)
    text = [
        "# Every key of a scenario",
        "A TOML file; [how a scenario is written](scenario.md) explains it by an example. An SSP archive is one too.",
        "## The file",
        _table(
            ("key", "type", "meaning"),
            [
                ("`format`", "1", "version of this format"),
                ("`name`", "text", "names the folder of the results; that of the file without it"),
                ("`title`", "text", "one line for lists and pages"),
                ("`description`", "text", "text for pages"),
                ("`warnings`", "list of texts", "what every reader of a result is told"),
                ("`connections`", "list of texts", f'`"a.x -> b.u"`, with a wish `"a.x -> b.n (round)"`: {wishes}'),
                ("`[experiment]`", "table", "below"),
                ("`[components.NAME]`", "table", "below, one for each component"),
                ("`[teleoperation]`", "table", "below"),
            ],
        ),
    ]
    for heading, kind in (
        ("[experiment]", Experiment),
        ("[components.NAME]", Component),
        ("[teleoperation]", Teleoperation),
    ):
        text += [f"## {heading}", *_class(kind)]
    return ManualPage("Reference", "scenario-keys", "\n\n".join(text) + "\n")


def sweep_page() -> ManualPage:
    """Keys of a sweep's TOML file."""
    from cosim.sweeps import spec

    kinds: tuple[tuple[str, type], ...] = (
        ("The file", spec.Sweep),
        ("[[axes]]", spec.Axis),
        ("[[axes.choices]]", spec.Choice),
        *((f"[{name}]", kind) for name, kind in spec.DESIGNS.items()),
    )
    text = ["# Every key of a sweep", "A TOML file; [how a sweep is written](sweep.md) explains it by an example."]
    text.append(f"`format` is {spec.FORMAT}. `curves` are some of {', '.join(f'`{c}`' for c in spec.CURVES)}.")
    for heading, kind in kinds:
        text += [f"## {heading}", *_class(kind)]
    return ManualPage("Reference", "sweep-keys", "\n\n".join(text) + "\n")


def _class(kind: type) -> list[str]:
    """A frozen class of settings as a paragraph and a table."""
    from attrs import fields

    from cosim.sweeps.spec import NOT_IN_A_FILE

    words = attribute_words(kind)
    rows = [
        (f"`{entry.name}`", _type(entry.type), _default(entry), words.get(entry.name, ""))
        for entry in fields(kind)
        if entry.name not in NOT_IN_A_FILE
    ]
    head = [inspect.cleandoc(kind.__doc__ or "")]
    return head + ([_table(("key", "type", "without it", "meaning"), rows)] if rows else [])


def attribute_words(kind: type) -> dict[str, str]:
    """The text that stands under each attribute in the source of a class."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
    assert isinstance(tree, ast.ClassDef)
    found = {}
    for above, below in pairwise(tree.body):
        match above, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(words))):
                found[name] = " ".join(words.split())
            case _:
                pass
    return found


_WORDS: Mapping[Any, str] = {float: "number", int: "whole number", str: "text", bool: "true or false", object: "value"}


def _type(kind: Any) -> str:
    """A type in the words of a TOML file."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (UnionType, Union):
        return " or ".join(_type(part) for part in parts if part is not type(None))
    if origin is Literal:
        return " or ".join(f"`{part!r}`" for part in parts)
    if origin is tuple:
        return f"list: {_type(parts[0])}"
    if isinstance(kind, type) and issubclass(kind, Enum):
        return " or ".join(f'`"{member.value}"`' for member in kind)
    if origin is not None and issubclass(origin, Mapping):
        return "table"
    return _WORDS.get(kind, "table")


def _default(entry: "Attribute[Any]") -> str:
    from attrs import NOTHING, Factory

    value: object = entry.default
    if value is NOTHING:
        return "must be given"
    if isinstance(value, Enum):
        value = value.value
    if value is None or value in ("", ()) or isinstance(value, Factory):  # pyright: ignore[reportArgumentType]
        return ""
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def commands_page() -> ManualPage:
    """Every command with its arguments and options, as `--help` has them."""
    from cosim.cli import COMMANDS, parsed_command

    text = [
        "# Every command",
        "`python -m cosim` works like `cosim`. Exit codes: 0 done, 1 the run failed, 2 bad input, 130 interrupted.",
    ]
    for name, line in COMMANDS.items():
        command = parsed_command(name)
        leaves = _leaves(f"cosim {name}", command)
        text.append(f"## cosim {name}")
        if len(leaves) > 1:
            text.append(f"{line[0].upper()}{line[1:]}.")
        for path, one in leaves:
            text += [f"### {path}"] if path != f"cosim {name}" else []
            text.append(inspect.cleandoc(one.help or ""))
            text += [_table(("argument or option", "meaning", "without it"), _options(one))] if one.params else []
    return ManualPage("Reference", "commands", "\n\n".join(text) + "\n")


def _leaves(path: str, command: "TyperCommand") -> list[tuple[str, "TyperCommand"]]:
    below: Mapping[str, TyperCommand] = getattr(command, "commands", {})
    return (
        [leaf for name, one in below.items() for leaf in _leaves(f"{path} {name}", one)] if below else [(path, command)]
    )


def _options(command: "TyperCommand") -> list[tuple[str, str, str]]:
    rows = []
    for option in command.params:
        names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
        if option.param_type_name == "argument":
            names = f"`{(option.name or '').upper()}`"
        default = "" if option.default in (None, [], ()) or callable(option.default) else f"`{option.default}`"
        rows.append((names, str(getattr(option, "help", "") or ""), "must be given" if option.required else default))
    return rows


def api_page() -> ManualPage:
    """What `import cosim` gives."""
    import cosim

    text = ["# The public API", inspect.cleandoc(cosim.__doc__ or "").replace("\n    ", "\n\n    ", 1)]
    for name in cosim.__all__:
        found = getattr(cosim, name)
        text += [f"## cosim.{name}", *_object(name, found)]
    return ManualPage("Reference", "api", "\n\n".join(text) + "\n")


def _object(name: str, found: object) -> list[str]:
    text = [] if isinstance(found, type) else [f"    {name}{_signature(found)}"]
    text.append(inspect.cleandoc(getattr(found, "__doc__", "") or ""))
    if not isinstance(found, type):
        return text
    rows = []
    for member, value in inspect.getmembers(found):
        whole = inspect.getdoc(value) or ""
        if member.startswith("_") or not (callable(value) or isinstance(value, property)) or isinstance(value, type):
            continue
        rows.append((f"`{member}{'' if isinstance(value, property) else _signature(value)}`", whole.split("\n\n")[0]))
    if issubclass(found, Enum):
        rows = [(f"`{one.value}`", str(getattr(one, "advice", ""))) for one in found]
    return [*text, _table(("name", "meaning"), rows)] if rows else text


def _signature(found: Any) -> str:
    try:
        return str(inspect.signature(found)).replace("'", "").replace("self, ", "").replace("(self)", "()")
    except (TypeError, ValueError):
        return "(...)"


def effects_page() -> ManualPage:
    """Every effect of the library with its equation."""
    from cosim.effects.registry import BUILT_IN

    rows = [(f"`{e.name}`", e.title, f"`{e.equation}`" if e.equation else "", e.unit, e.source) for e in BUILT_IN]
    text = (
        "# Every effect that can be named\n\n"
        "Torque that an effect adds to the model of the arm. Parameters and full equations stand in the page of "
        "[PhantomArm](model-PhantomArm.md), how a name is decided in [closing the loop](closing-the-loop.md).\n\n"
    )
    return ManualPage(
        "Reference", "effects", text + _table(("name", "what it is", "equation", "unit", "source"), rows) + "\n"
    )


def model_pages() -> tuple[ManualPage, ...]:
    """Every model: its README (equations) and its variables."""
    from build_fmus.documentation import HEADS, variable_cells
    from build_fmus.sources import home_of, model_table, models, readme_of

    pages = []
    for model in models():
        rows = [(f"`{cells[0]}`", *cells[1:]) for cells in map(variable_cells, model_table(model).variable)]
        text = f"{readme_of(home_of(model)).strip()}\n\n## Variables\n\n{_table(HEADS, rows)}\n"
        pages.append(ManualPage("Models", f"model-{model}", text, f"fmu_src/{model}/README.md"))
    return tuple(pages)


def _table(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """A Markdown table."""
    names = list(header)
    lines = [names, ["---"] * len(names), *rows]
    return "\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in lines)


def _cell(text: object) -> str:
    return str(text).replace("|", "\\|").replace("\n", " ")
