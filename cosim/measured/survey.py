"""What measured files hold: columns with guessed roles and units, runs with their rates and ranges, and doubts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import field, frozen

from cosim.errors import InputError, Problem
from cosim.measured.assembly import read
from cosim.measured.description import RecordingDescription, load_description, parse_description
from cosim.measured.guesses import ColumnGuess, guessed
from cosim.measured.reader import read_table
from cosim.measured.recording import Recording
from cosim.measured.template import PAGE, Draft, text

LISTED = ("q", "tau", "dq", "ddq", "q_ref")
ONE = ("time", "run", "split", "supply")


@frozen(eq=False)
class Survey:
    """What files hold. recording: as it is read with the description; None where it cannot be, `problems` says why.

    draft: the text of a description file; empty where one was given or lies beside the data.
    """

    files: tuple[str, ...]
    columns: tuple[ColumnGuess, ...]
    draft: str
    described_by: str
    recording: Recording | None
    problems: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def left_out(self) -> list[str]:
        """Columns that look like those that the draft describes and are not in it."""
        if not self.draft or self.recording is None:
            return []
        names = self.recording.description.columns
        texts = []
        for role in LISTED:
            used = names.of_role(role)
            others = [c.name for c in self.columns if c.role == role and c.name not in used]
            if used and others:
                texts.append(f"{', '.join(others[:8])} look like {role} as well; described is {', '.join(used)}")
        return texts

    def to_dict(self) -> dict[str, Any]:
        """The content of data.json."""
        recording = self.recording
        return {
            "files": list(self.files),
            "columns": [_column(column) for column in self.columns],
            "described_by": self.described_by,
            "runs": [] if recording is None else _runs(recording),
            "not_described": self.left_out,
            "doubts": [] if recording is None else [doubt.to_dict() for doubt in recording.doubts],
            "warnings": list(self.notes if recording is None else recording.warnings),
            "problems": list(self.problems),
        }

    def lines(self) -> list[str]:
        """For the terminal."""
        lines = [f"{', '.join(self.files)}: {len(self.columns)} columns"]
        lines += [_told(column) for column in self.columns[:40]]
        if len(self.columns) > 40:
            lines.append(f"  and {len(self.columns) - 40} more (data.json has all)")
        if self.recording is None:
            return [*lines, *(f"cannot be used as described: {problem}" for problem in self.problems)]
        runs = _runs(self.recording)
        lines += [
            f"run {run['name']}: {run['rows']} rows, {run['seconds']:.4g} s at {run['rate']:.6g} Hz"
            for run in runs[:12]
        ]
        if len(runs) > 12:
            lines.append(f"and {len(runs) - 12} more runs (data.json has all)")
        lines += [f"not described: {text}" for text in self.left_out]
        doubts = [f"doubt ({doubt.kind}, {doubt.done.value}): {doubt.text}" for doubt in self.recording.doubts]
        return [*lines, *(doubts or ["nothing looks wrong"])]


def survey(files: Sequence[Path], description: Path | None = None) -> Survey:
    """Read files with the description given or beside them, else with a guessed one. Raises InputError where a file
    cannot be read at all.
    """
    if not files:
        raise InputError(Problem("files", "at least one recording", "none"))
    table = read_table(files[0])
    columns = guessed(table)
    names = tuple(str(file) for file in files)
    beside = files[0].with_suffix(".toml")
    given = description or (beside if beside.exists() else None)
    draft = "" if given else _draft(columns, files[0])
    try:
        described = load_description(given) if given else _parsed(draft, files[0])
        recording = read([table, *files[1:]], description=described)
    except InputError as error:
        problems = tuple(map(str, error.problems))
        return Survey(names, columns, draft, str(given or "guesses"), None, problems, table.warnings)
    return Survey(names, columns, draft, str(given or "guesses"), recording)


def _parsed(draft: str, file: Path) -> RecordingDescription:
    import tomllib

    return parse_description(tomllib.loads(draft), f"guessed description of {file.name} (see {PAGE})")


def _draft(columns: tuple[ColumnGuess, ...], file: Path) -> str:
    """A description from the guesses: three joints are a PHANToM, one is an axis; of others the first is taken."""
    of = {role: tuple(c.name for c in columns if c.role == role) for role in (*LISTED, *ONE, "temperature")}
    joints = 3 if len(of["q"]) == len(of["tau"]) == 3 else 1
    chosen = {role: names[:joints] if role in LISTED else names[:1] for role, names in of.items() if names}
    chosen = {role: names for role, names in chosen.items() if role not in LISTED or len(names) == joints}
    warm = of["temperature"]
    units, reasons = {}, dict.fromkeys(warm, "degC")
    for column in columns:
        named = column.name in chosen.get(column.role, ())
        if named and column.unit and column.role in ("time", *LISTED):
            units.setdefault(column.role, column.unit)
            reasons.setdefault(column.role, column.why)
    chosen.pop("temperature", None)
    if warm:
        chosen["other"] = warm
    units = {role: unit for role, unit in units.items() if unit != "degC"}
    return text(Draft("phantom" if joints == 3 else "axis", chosen, units, reasons, file.name))


def _column(column: ColumnGuess) -> dict[str, Any]:
    return {
        "name": column.name,
        "kind": column.kind,
        "rows": column.rows,
        "range": None if column.low is None else [column.low, column.high],
        "role": column.role,
        "unit": column.unit,
        "why": column.why,
    }


def _told(column: ColumnGuess) -> str:
    span = f", {column.low:.6g} to {column.high:.6g}" if column.low is not None else ""
    unit = f" [{column.unit}: {column.why}]" if column.unit else ""
    role = f" -> {column.role}" if column.role else ""
    return f"  {column.name}: {column.rows} {column.kind}{span}{role}{unit}"


def _runs(recording: Recording) -> list[dict[str, Any]]:
    return [
        {
            "name": run.name,
            "rows": len(run),
            "seconds": float(run.time[-1] - run.time[0]),
            "rate": 1 / run.step,
            "held_out": int(run.test.sum()),
            "clipped": 0 if run.clipped is None else int(run.clipped.any(axis=1).sum()),
            "ranges": {
                f"{role} {joint}": [float(x) for x in (np.min(values[:, k]), np.max(values[:, k]))]
                for role, values in (("q", run.q), ("tau", run.tau))
                for k, joint in enumerate(recording.joints)
            },
        }
        for run in recording.runs
    ]
