"""Files to a Recording: descriptions found, units applied, runs separated, repairs made, held-out rows marked."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from attrs import evolve, frozen

from cosim.errors import InputError, Problem
from cosim.measured import doubts, units
from cosim.measured.columns import LISTS, ColumnNames
from cosim.measured.description import RecordingDescription, load_description
from cosim.measured.mounted import RECORDED, TEMPERATURE
from cosim.measured.notes import Notes
from cosim.measured.reader import RawTable, needed, read_table
from cosim.measured.recording import Recording, Run
from cosim.measured.repairs import recentred, repair
from cosim.measured.stretch import Stretch

# What scenario `identification` records: encoder angles, and the torque that the amplifier holds from one sample to
# the next.
SIMULATED = RecordingDescription(
    columns=ColumnNames(
        q=("arm.q[1]", "arm.q[2]", "arm.q[3]"),
        tau=("controller.tau[1]", "controller.tau[2]", "controller.tau[3]"),
        q_ref=("excitation.q_ref[1]", "excitation.q_ref[2]", "excitation.q_ref[3]"),
    ),
    torque_held=True,
    coulomb_velocity=0.01,  # default of the FMU PhantomArm
    source="scenario identification",
)


@frozen(eq=False)
class _FilePart:
    """Rows of one run in a file, before repair: columns by role, split labels or None."""

    name: str
    rows: np.ndarray
    test: np.ndarray | None


def read(
    paths: Iterable[Path | str | RawTable],
    test: Iterable[Path | str] = (),
    description: Path | str | RecordingDescription | None = None,
) -> Recording:
    """Read files, or tables that were read from some, into one recording; `test` files are held out.

    Held-out rows: those of `test`, else of the split column, else the second half of each recording. Raises InputError
    with what is wrong where; repairs are in the recording's `warnings`.
    """
    given, held = list(paths), [Path(path) for path in test]
    if not given:
        raise InputError(Problem("files", "at least one recording", "none"))
    fitted = [one if isinstance(one, RawTable) else read_table(Path(one)) for one in given]
    fit = [table.path for table in fitted]
    tables = [(table, False) for table in fitted] + [(read_table(path), True) for path in held]
    _same_file_twice(fit, held)
    chosen = _description([table for table, _ in tables], description)
    notes = Notes()
    for table, _ in tables:
        for text in table.warnings:
            notes(text)
    _torque_told(chosen, notes)
    runs = _held_out(_runs(tables, chosen, notes), bool(held), notes)
    recording = Recording(chosen, tuple(runs), files=tuple(str(path) for path in (*fit, *held)))
    recording = doubts.checked(recording, notes)
    return evolve(recording, warnings=tuple(notes.warnings), doubts=tuple(notes.doubts))


def _torque_told(description: RecordingDescription, note: Notes) -> None:
    """Say what parameters carry where the factor from tau to a torque is not known."""
    unit = description.torque_unit
    if unit == description.si["tau"]:
        return
    text = f"tau is in {unit} and no [scale] tau says how much torque that is: parameters carry {unit} for N.m"
    if description.servo and description.servo.gain is None:
        text = f"the servo's gain is not known: parameters carry {unit} of its error for {description.si['tau']}"
    if unit in ("V", "duty") and not description.back_emf:
        text += "; viscous friction holds the back-EMF of the motor ([motor] back_emf takes it out)"
    note(text, "unknown torque constant")


def _same_file_twice(fit: Sequence[Path], held: Sequence[Path]) -> None:
    both = sorted({p.resolve() for p in fit} & {p.resolve() for p in held})
    if both:
        raise InputError(Problem("--test", "files that are not fitted", str(both[0]), "leave it out of one of the two"))


def _description(tables: Sequence[RawTable], given: Path | str | RecordingDescription | None) -> RecordingDescription:
    """The one description of all files: given, else beside the files, else the plain PHANToM one."""
    if isinstance(given, RecordingDescription):
        return given
    if given is not None:
        return load_description(given)
    beside = {p: load_description(p) for t in tables if (p := t.path.with_suffix(".toml")).exists()}
    if not beside:
        return _default(tables[0])
    first, *rest = beside.items()
    for path, other in rest:
        if evolve(other, source="") != evolve(first[1], source=""):
            advice = "files of one call need the same description"
            raise InputError(Problem(str(path), f"the same as {first[0]}", "another description", advice))
    return first[1]


def _default(table: RawTable) -> RecordingDescription:
    if all(name in table.columns for name in SIMULATED.columns.q):
        columns = SIMULATED.columns
        references = columns.q_ref if all(name in table.columns for name in columns.q_ref) else ()
        return evolve(SIMULATED, columns=evolve(columns, q_ref=references))
    return RecordingDescription()


def _runs(
    tables: Sequence[tuple[RawTable, bool]], description: RecordingDescription, note: Notes
) -> list[tuple[Run, bool | None]]:
    """Repaired runs; beside each: held out as a whole (True), by its own mask (None), or not said (False)."""
    runs, problems = [], []
    several = len(tables) > 1
    for table, held in tables:
        try:
            columns = needed(table, description, note)
            for part in _parts(table.path.stem, columns, description, several):
                runs += _repaired(part, columns, description, held, note)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return runs


def _parts(
    stem: str, columns: dict[str, np.ndarray], description: RecordingDescription, several: bool
) -> list[_FilePart]:
    """Rows of each run label; a run may not be joined to another."""
    names = description.columns
    count = len(columns[names.time])
    test = _split(stem, columns[names.split]) if names.split else None
    if not names.run:
        return [_FilePart(stem, np.arange(count), test)]
    labels = columns[names.run]
    order = list(dict.fromkeys(labels.tolist()))
    rows = [np.flatnonzero(labels == label) for label in order]
    return [
        _FilePart(f"{stem}:{label}" if several else label, row, None if test is None else test[row])
        for label, row in zip(order, rows, strict=True)
    ]


def _split(stem: str, labels: np.ndarray) -> np.ndarray:
    lower = np.char.lower(np.char.strip(labels.astype(str)))
    wrong = sorted(set(lower.tolist()) - {"train", "test"})
    if wrong:
        raise InputError(Problem(f"{stem}: split", "train or test", ", ".join(map(repr, wrong[:4]))))
    if (lower == "test").all():
        raise InputError(Problem(f"{stem}: split", "rows to fit on", "test rows only"))
    return lower == "test"


def _repaired(
    part: _FilePart,
    columns: Mapping[str, np.ndarray],
    description: RecordingDescription,
    held: bool,
    note: Notes,
) -> list[tuple[Run, bool | None]]:
    layout = _layout(description)
    signals = np.column_stack([columns[name][part.rows] * factor for _, name, factor in layout])
    time = columns[description.columns.time][part.rows]
    test = np.zeros(len(part.rows), bool) if part.test is None else part.test
    positions = tuple(k for k, (role, _, _) in enumerate(layout) if role in ("q", "q_ref"))
    names = tuple(name for _, name, _ in layout)
    torques = tuple(k for k, (role, _, _) in enumerate(layout) if role == "tau")
    factors = tuple(factor for _, _, factor in layout)
    angles = not description.prismatic
    computed = tuple(k for k, (role, _, _) in enumerate(layout) if role in ("regressor", "rigid", *RECORDED))
    spans = tuple(_span(columns[name]) * abs(factor) for _, name, factor in layout)
    stretch = Stretch(
        part.name, time, signals, names, test, positions, angles, torques, computed, factors, spans, part.rows
    )
    held_torque = torques if description.torque_held else ()
    whole = True if held else (None if part.test is not None else False)
    pieces = [recentred(piece, held_torque, note) for piece in repair(stretch, note)]
    return [(_with_load(_run(piece, layout, description), piece, layout, description), whole) for piece in pieces]


def _span(values: np.ndarray) -> float:
    """Range of the middle 99 % of a column."""
    finite = values[np.isfinite(values)]
    return float(np.subtract(*np.quantile(finite, (0.995, 0.005)))) if len(finite) else 0.0


def _layout(description: RecordingDescription) -> list[tuple[str, str, float]]:
    """(role, column, factor to SI) of every signal except time."""
    names = description.columns
    layout = [(role, name, description.factor(role, k)) for role in LISTS for k, name in enumerate(names.of_role(role))]
    single = ((role, names.single(role)) for role in ("rigid", "supply", *RECORDED))
    layout += [(role, name, description.factor(role, 0)) for role, name in single if name]
    return layout + [("other", name, _other_factor(unit)) for name, unit in names.other.items()]


def _other_factor(unit: str) -> float:
    return units.FACTORS.get(units.spelled(unit), ("", 1.0))[1]


def _with_load(
    run: Run, stretch: Stretch, layout: Sequence[tuple[str, str, float]], description: RecordingDescription
) -> Run:
    """The run with what was mounted on it, by its columns or by the keys of the description for a run of its name."""
    label = re.sub(r"(#\d+)?(/\d+)?$", "", run.name)
    names = (run.name, label, label.rsplit(":", 1)[-1])
    mounted = next(
        (description.mounted_in[name] for name in names if name in description.mounted_in), description.mounted
    )
    if description.warm:
        warmth = np.full(len(run), np.nan if mounted.temperature is None else mounted.temperature)
        run = evolve(run, other={**run.other, TEMPERATURE: warmth})
    if not description.loaded:
        return run
    recorded = {role: stretch.signals[:, k] for k, (role, _, _) in enumerate(layout) if role in RECORDED}
    return evolve(run, load=mounted.load(recorded, len(run)))


def _run(stretch: Stretch, layout: Sequence[tuple[str, str, float]], description: RecordingDescription) -> Run:
    def block(role: str) -> np.ndarray | None:
        columns = [k for k, (r, _, _) in enumerate(layout) if r == role]
        return np.ascontiguousarray(stretch.signals[:, columns]) if columns else None

    q, rigid = block("q"), block("rigid")
    assert q is not None, "every description names the columns of q"
    other = {name: stretch.signals[:, k].copy() for k, (role, name, _) in enumerate(layout) if role == "other"}
    run = Run(
        name=stretch.name,
        time=stretch.time,
        q=q,
        tau=np.zeros_like(q),
        test=stretch.test,
        dq=block("dq"),
        ddq=block("ddq"),
        q_ref=block("q_ref"),
        force=block("force"),
        regressor=block("regressor"),
        rigid=None if rigid is None else rigid[:, 0],
        other=other,
        pace=stretch.pace,
    )
    return _at_supply(_driven(run, block("tau"), stretch, layout, description), block("supply"), description)


def _driven(
    run: Run,
    tau: np.ndarray | None,
    stretch: Stretch,
    layout: Sequence[tuple[str, str, float]],
    description: RecordingDescription,
) -> Run:
    """The run with its torque as recorded, or as its servo makes it of the error."""
    servo = description.servo
    if servo is None:
        torques = [k for k, (role, _, _) in enumerate(layout) if role == "tau"]
        assert tau is not None, "every description without a servo names the columns of tau"
        return evolve(run, tau=tau, clipped=None if stretch.clipped is None else stretch.clipped[:, torques])
    assert run.q_ref is not None, "the description of a servo names the columns of q_ref"
    error = run.q_ref - run.q
    factor = description.factor("tau", 0)
    side = servo.side(error)
    side = None if side is None else side * factor
    return evolve(run, tau=servo.output(error) * factor, servo=side, clipped=servo.at_limit(error))


def _at_supply(run: Run, supply: np.ndarray | None, description: RecordingDescription) -> Run:
    """A duty cycle times its supply is the voltage of the motor."""
    if supply is None and not description.supply:
        return run
    volts = description.supply if supply is None else supply
    return evolve(run, tau=run.tau * volts, servo=None if run.servo is None else run.servo * volts)


def _held_out(runs: list[tuple[Run, bool | None]], test_given: bool, note: Notes) -> list[Run]:
    """Mark the held-out rows by the rule of the contract."""
    split = any(whole is None for _, whole in runs)
    if test_given or split:
        marked = [evolve(run, test=np.ones(len(run), bool)) if whole is True else run for run, whole in runs]
        if not any(run.train.any() for run in marked):
            raise InputError(Problem("split", "rows to fit on", "held-out rows only"))
        return marked
    note("no --test and no split column: the second half of each recording is held out")
    return [evolve(run, test=np.arange(len(run)) >= len(run) // 2) for run, _ in runs]
