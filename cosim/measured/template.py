"""The text of a description file with every key explained, filled with what is known of a file."""

from collections.abc import Mapping

from attrs import frozen

from cosim.measured.columns import SINGLE

PAGE = "`cosim docs description-format`"
SERVO = (
    "# [servo]  # axis: a position servo, with q_ref and without tau: tau = gain (e - dead_band sgn(e)), e = q_ref - q",
    "# gain = 1.0  # unit of tau per rad; without it parameters carry rad of the error for N.m",
    "# dead_band = 0.0  # rad; without it it is fitted along",
    "# limit = 1.0  # rad of error from which on its output is at its end: those rows are left out",
)


@frozen
class Draft:
    """Names of the columns of each role, and the unit of each role that has one, with the reason for it."""

    device: str
    columns: Mapping[str, tuple[str, ...]]
    units: Mapping[str, str]
    reasons: Mapping[str, str]
    source: str


def text(draft: Draft) -> str:
    """A description file that `identify` and `close-loop` take as it is."""
    parts = [_head(draft), _columns(draft), _units(draft.units, draft.reasons), _rest()]
    return "\n".join(line for part in parts for line in part) + "\n"


def _head(draft: Draft) -> list[str]:
    phantom, axis = draft.device == "phantom", draft.device == "axis"
    return [
        f"# What the columns of {draft.source} are. Guesses are marked; every key is explained in {PAGE}.",
        f'device = "{draft.device}"  # "phantom" (3 joints), "axis" (one joint), "regressor" (given columns)',
        _line('configuration = "UR"', "PHANToM: mounting; UR, GCW, FS, USD, USD+GCW", phantom),
        _line('parameters = "fit"', 'PHANToM: or "declared": declared_pi = [8 numbers] are trusted', phantom),
        _line('joint = "joint"', "a label for the results", axis),
        _line("gravity = false", "axis: true where a sin q + b cos q belongs to the model (a pendulum)", axis),
        _line("torque_held = false", "true where tau is a command that is held from its stamp to the next", True),
        _line("coulomb_velocity = 0.0", "rad/s over which the sign of dq is known to be smooth; 0: not known", True),
        "",
    ]


def _columns(draft: Draft) -> list[str]:
    explained = {
        "time": "stamps: numbers or dates",
        "q": "positions, one name a joint",
        "tau": "torques, forces, currents, duty cycles or voltages",
        "dq": "speeds (optional)",
        "ddq": "accelerations (optional)",
        "q_ref": "references of the controller (optional)",
        "force": "force at the tip, 3 columns (optional)",
        "supply": "supply voltage [V] beside a duty cycle (optional)",
        "run": "recordings that must not be joined (optional)",
        "split": '"train" or "test" in each row (optional)',
        "mass": "kg that is mounted, beside length (optional)",
        "length": "m from the axis to the mounted mass (optional)",
        "inertia": "kg m^2 that is mounted, beside mass length^2 (optional)",
        "angle": "rad: q at which the mounted mass hangs straight down (optional)",
    }
    lines = ["[columns]"]
    for role, words in explained.items():
        names = draft.columns.get(role, ())
        if role in SINGLE:
            value = f"{role} = {quoted(names[0] if names else role)}"
        else:
            value = f"{role} = [{', '.join(map(quoted, names or (role,)))}]"
        lines.append(_line(value, words, bool(names)))
    other = ", ".join(
        f"{quoted(name)} = {quoted(draft.reasons.get(name, ''))}" for name in draft.columns.get("other", ())
    )
    shown = other or 'temperature = "degC"'
    lines.append(
        _line(f"other = {{ {shown} }}", "further signals that friction may depend on, with units", bool(other))
    )
    return [*lines, ""]


def _units(units: Mapping[str, str], reasons: Mapping[str, str]) -> list[str]:
    lines = ["[units]  # where they are not s, rad and N.m; A, V, duty, counts: without [scale] results carry them"]
    for role in ("time", "q", "tau", "dq", "ddq", "q_ref"):
        unit = units.get(role, "")
        why = f"guessed: {reasons[role]}" if unit and reasons.get(role) else "the unit of these columns"
        lines.append(_line(f'{role} = "{unit or _usual(role)}"', why, bool(unit)))
    return [*lines, ""]


def _usual(role: str) -> str:
    return {"time": "s", "q": "rad", "tau": "N.m", "dq": "rad/s", "ddq": "rad/s^2", "q_ref": "rad"}[role]


def _rest() -> list[str]:
    return [
        "[scale]  # factors beside the units: a torque constant [N.m/A], a sign",
        _line("tau = 1.0", "SI per number in the file", False),
        _line("q = 1.0", "SI per number in the file", False),
        "",
        "[motor]  # for tau in V or duty",
        _line("supply = 12.0", "V: tau is a duty cycle of it (or [columns] supply, where it was recorded)", False),
        _line("back_emf = 0.0", "V s/rad: tau is U - back_emf dq; without it `viscous` holds the back-EMF", False),
        "",
        "[gear]  # between the motor and the joint",
        _line("ratio = 1.0", "turns of the motor for one of the joint; negative: the joint turns the other way", False),
        _line('encoder = "joint"', 'the side of q: "joint" or "motor"', False),
        _line('torque = "joint"', 'the side of tau, of the torque constant and of back_emf: "joint" or "motor"', False),
        "",
        *SERVO,
        "",
        "[mounted]  # axis: what was on the joint, in all runs; [mounted.NAME] for the run NAME; also as columns",
        _line("mass = 0.0", "kg", False),
        _line("length = 0.0", "m from the axis to the mass", False),
        _line("inertia = 0.0", "kg m^2 about the axis, beside mass length^2", False),
        _line("angle = 0.0", "rad: q at which the mass hangs straight down", False),
        _line("temperature = 20.0", "degC of the run", False),
    ]


def _line(value: str, words: str, used: bool) -> str:
    return f"{'' if used else '# '}{value}  # {words}"


def quoted(name: str) -> str:
    """A TOML string."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"').replace("\t", "\\t").replace("\n", "\\n")
    return f'"{escaped}"'
