"""The course of a sweep: points asked for in rounds, answered from the journal or by workers, until the design is
done.
"""

import json
import time
from collections.abc import Callable, Generator, Iterable, Sequence
from hashlib import sha256
from itertools import product
from pathlib import Path

import numpy as np
from attrs import asdict, evolve, field, frozen

from cosim.engine.outcome import Outcome
from cosim.sweeps.audit import Audit, AuditPlan, audited
from cosim.sweeps.boundary import Boundary, Precision, trace_line
from cosim.sweeps.bracket import Places
from cosim.sweeps.evaluate import EVALUATORS
from cosim.sweeps.journal import Journal
from cosim.sweeps.level_set import Budget, learn
from cosim.sweeps.points import Point, PointResult, point
from cosim.sweeps.pool import Task, Workers
from cosim.sweeps.spec import Axis, BoundaryDesign, Choice, Entry, Grid, LevelSet, Sweep

Round = list[Point]
Course = Generator[Round, list[PointResult], "tuple[Curve, ...]"]
Traced = tuple[Boundary, Audit | None]


@frozen
class Curve:
    """One traced boundary: which entries of the other axes it belongs to, lines of (x, y) in axis units, what the audit
    found.
    """

    label: str
    others: tuple[tuple[str, float | str], ...]
    lines: tuple[tuple[tuple[float, ...], ...], ...]
    audit: Audit | None = None


@frozen
class Campaign:
    """A sweep that was carried out: points in the order in which they were first asked for, findings, curves."""

    sweep: Sweep
    task: Task
    points: tuple[Point, ...]
    findings: tuple[PointResult, ...] = field(repr=False)
    curves: tuple[Curve, ...] = ()
    executor: str = ""
    known_before: int = 0
    wall_time: float = 0.0
    warnings: tuple[str, ...] = ()

    @property
    def failure(self) -> str | None:
        """Why there is no result at all: the words of the first point, where every point failed."""
        if not self.findings or any(found.outcome != Outcome.FAILED.value for found in self.findings):
            return None
        return self.findings[0].message


@frozen
class SweepProgress:
    """Points done of those asked for so far, how many of them in this call, seconds since it began."""

    done: int
    asked: int
    fresh: int
    wall: float

    @property
    def rate(self) -> float:
        """Points a second in this call."""
        return self.fresh / self.wall if self.wall > 0 else 0.0

    @property
    def left(self) -> float:
        """Seconds left for what is asked for so far; infinite before the first answer."""
        return (self.asked - self.done) / self.rate if self.rate > 0 else np.inf

    def __str__(self) -> str:
        left = f" {self.left:.0f} s left" if self.left < 1e6 else ""
        return f"{self.done} of {self.asked} points, {self.rate:.3g}/s{left}"


def task_of(sweep: Sweep) -> Task:
    """What workers need to know of the sweep; scenario files are named from the sweep's folder."""
    scenario = sweep.scenario
    if scenario.endswith(".toml"):
        scenario = str((sweep.folder / scenario).resolve())
    evaluator = EVALUATORS.get(sweep.evaluator, sweep.evaluator)
    traced = isinstance(sweep.design, (BoundaryDesign, LevelSet))
    return Task(evaluator, scenario, dict(sweep.set), sweep.effects, sweep.sign_level, sweep.any_delay, traced)


def fingerprint(task: Task, origin: str = "") -> str:
    """Hash of what decides a finding besides the point: evaluator, scenario, fixed values, effects, `origin` (FMUs)."""
    home, _, function = task.evaluator.rpartition(":")
    evaluator = [Path(home).read_text(encoding="utf-8"), function] if home.endswith(".py") else task.evaluator
    asked = [] if task.sign_level is None else [task.sign_level] + (["traced"] if task.traced else [])
    asked += ["any_delay"] if task.any_delay else []
    texts = [json.dumps([evaluator, sorted(map(str, task.set.items())), *asked]), origin]
    for name in (task.scenario, task.effects):
        path = Path(name) if name else None
        texts.append(path.read_text(encoding="utf-8") if path and path.is_file() else str(name))
    return sha256("\n".join(texts).encode()).hexdigest()[:24]


def run_sweep(
    sweep: Sweep,
    folder: Path,
    workers: Workers,
    executor: str = "",
    chunk: int = 4,
    tell: Callable[[SweepProgress], None] | None = None,
    origin: str = "",
) -> Campaign:
    """Carry the sweep out, or go on with it: what the journal in `folder` holds is not computed again.

    Which points are asked for, and in which order, depends on results only, so that any number of workers gives the
    same table. A round that would leave workers idle is filled up, to `chunk` points for each, with points that will be
    needed in any case: those of the audit; who has done his part of a round takes more of them. Raises InputError where
    the folder holds another sweep.
    """
    began, task = time.perf_counter(), task_of(sweep)
    with Journal(folder / "journal.jsonl", fingerprint(task, origin)) as journal:
        before = len(journal.findings)
        board = _AskedPoints(task, journal, workers, chunk, tell, _ahead(sweep))
        course = _course(sweep)
        try:
            asked = next(course)
            while True:
                asked = course.send(board.answer(asked))
        except StopIteration as end:
            curves = end.value
        points = tuple(board.asked.values())
        findings = tuple(journal.findings[p.key] for p in points)
        warnings = tuple(journal.damaged)
    return Campaign(sweep, task, points, findings, curves, executor, before, time.perf_counter() - began, warnings)


class _AskedPoints:
    """Points asked for so far, in order, and the journal that remembers what was found."""

    def __init__(
        self,
        task: Task,
        journal: Journal,
        workers: Workers,
        chunk: int,
        tell: Callable[[SweepProgress], None] | None,
        ahead: Round,
    ) -> None:
        self.task, self.journal, self.workers, self.chunk, self.tell, self.ahead = (
            task,
            journal,
            workers,
            chunk,
            tell,
            {p.key: p for p in ahead},
        )
        self.asked: dict[str, Point] = {}
        self.began, self.fresh, self.done = time.perf_counter(), 0, 0

    def answer(self, points: Round) -> list[PointResult]:
        """Findings of the points, in their order."""
        fresh = {p.key: p for p in points if p.key not in self.asked}
        self.asked |= fresh
        self.done += sum(key in self.journal.findings for key in fresh)
        missing = self._unknown(points)
        room = -len(missing) % (self.chunk * self.workers.count)
        taken = {p.key for p in missing}
        beside = [p for p in self._unknown(self.ahead.values()) if p.key not in taken][:room]
        self._report()
        dealt = _dealt(sorted(missing, key=_choices), beside, self.workers.count)
        self.workers.spare = self._unknown(self.ahead.values())
        for answered, findings in self.workers.answers(self.task, dealt, self.chunk):
            self.done += sum(p.key in self.asked and p.key not in self.journal.findings for p in answered)
            self.journal.add(answered, findings)
            self.fresh += len(answered)
            self._report()
        return [self.journal.findings[p.key] for p in points]

    def _unknown(self, points: Iterable[Point]) -> Round:
        """Each once; what is evaluated does not depend on whether it is asked for already or will be."""
        return [
            self.ahead.get(key, p) for key, p in {p.key: p for p in points}.items() if key not in self.journal.findings
        ]

    def _report(self) -> None:
        if self.tell:
            self.tell(SweepProgress(self.done, len(self.asked), self.fresh, time.perf_counter() - self.began))


def _choices(point: Point) -> list[str]:
    """What was chosen by name, a model perhaps: the batch kernel runs points together that have it in common."""
    return [entry for entry in point.entries if isinstance(entry, str)]


def _dealt(asked: Round, beside: Round, count: int) -> Round:
    """The points in `count` shares alike, one after the other: those asked for lie near the boundary and take longer
    than those beside them.
    """

    def part(points: Round, k: int) -> Round:
        return points[k * len(points) // count : (k + 1) * len(points) // count]

    return [p for k in range(count) for p in (*part(asked, k), *part(beside, count - 1 - k))]


# --- designs ----------------------------------------------------------------------------------------------------------


def first_point(sweep: Sweep) -> Point:
    """A point of the sweep, to check it with."""
    return point(sweep.axes, [axis.steps()[0] for axis in sweep.axes])


def every_choice(sweep: Sweep) -> list[Point]:
    """The first point, and one for every further choice of an axis of choices."""
    first = [axis.steps()[0] for axis in sweep.axes]
    others = [[*first[:k], choice, *first[k + 1 :]] for k, axis in enumerate(sweep.axes) for choice in axis.choices[1:]]
    return [point(sweep.axes, entries) for entries in (first, *others)]


def _course(sweep: Sweep) -> Course:
    design = sweep.design
    if isinstance(design, (BoundaryDesign, LevelSet)):
        return _traced(sweep, design)
    if isinstance(design, Grid):
        return _listed([point(sweep.axes, entries) for entries in product(*(axis.steps() for axis in sweep.axes))])
    rng = np.random.default_rng(design.seed)
    return _listed([point(sweep.axes, [axis.random(rng) for axis in sweep.axes]) for _ in range(design.count)])


def _listed(points: Sequence[Point]) -> Course:
    if points:
        yield list(points)
    return ()


def _traced(sweep: Sweep, design: BoundaryDesign | LevelSet) -> Course:
    """All tracers of the sweep side by side: their rounds are put together, so that workers have enough to do."""
    combinations = _combinations(sweep)
    tracers = [_tracer(design) for _ in combinations]
    asked = [next(tracer) for tracer in tracers]
    found: list[Traced | None] = [None] * len(tracers)
    while any(result is None for result in found):
        live = [k for k, result in enumerate(found) if result is None]
        points = [[_place(sweep, combinations[k], shares) for shares in asked[k]] for k in live]
        answers = iter((yield [p for some in points for p in some]))
        for k, some in zip(live, points):
            rates = [next(answers).rate for _ in some]
            try:
                asked[k] = tracers[k].send(rates)
            except StopIteration as end:
                found[k] = end.value if isinstance(end.value, tuple) else (end.value, None)
    return tuple(_curve(sweep, entries, *result) for entries, result in zip(combinations, found) if result is not None)


def _combinations(sweep: Sweep) -> list[tuple[Entry, ...]]:
    """Entries of the axes that are not traced, a boundary each."""
    return list(product(*(axis.steps() for axis in sweep.enumerated)))


def _ahead(sweep: Sweep) -> Round:
    """Points that will be asked for whatever is found: those of the first audit, which only compares signs."""
    if not isinstance(sweep.design, BoundaryDesign) or len(sweep.traced) != 2:
        return []
    return [
        evolve(_place(sweep, others, shares), sign_alone=True)
        for others in _combinations(sweep)
        for shares in next(_audit(sweep.design).draws())
    ]


def _audit(design: BoundaryDesign) -> AuditPlan:
    return AuditPlan(design.audit, design.audit_rounds, design.seed + 1, design.level)


def _tracer(design: BoundaryDesign | LevelSet) -> Generator[Places, list[float], Boundary | tuple[Boundary, Audit]]:
    if isinstance(design, LevelSet):
        return learn(Budget(design.count, design.start, design.batch, design.seed))
    precision = Precision(design.tolerance, design.cells, design.seed)
    if len(design.trace) == 1:
        return trace_line(precision)
    return audited(precision, _audit(design))


def _place(sweep: Sweep, others: Sequence[Entry], shares: Sequence[float]) -> Point:
    """The point at shares of the traced axes and entries of the others."""
    chosen: dict[str, Entry] = {axis.name: axis.number(s) for axis, s in zip(sweep.traced, shares)}
    chosen |= {axis.name: entry for axis, entry in zip(sweep.enumerated, others)}
    return point(sweep.axes, [chosen[axis.name] for axis in sweep.axes])


def _curve(sweep: Sweep, others: Sequence[Entry], boundary: Boundary, audit: Audit | None) -> Curve:
    named = tuple(
        (axis.name, entry.label if isinstance(entry, Choice) else entry)
        for axis, entry in zip(sweep.enumerated, others)
    )
    label = ", ".join(_labelled(axis, entry) for axis, (_, entry) in zip(sweep.enumerated, named))
    lines = tuple(
        tuple(tuple(axis.number(float(s)) for axis, s in zip(sweep.traced, vertex)) for vertex in curve)
        for curve in boundary.curves
    )
    return Curve(label, named, lines, audit)


def _labelled(axis: Axis, entry: float | str) -> str:
    return str(entry) if isinstance(entry, str) else f"{axis.name} {entry:g} {axis.unit}".rstrip()


def settings(sweep: Sweep) -> dict[str, object]:
    """The sweep as plain values, for the summary."""
    return {
        "name": sweep.name,
        "scenario": sweep.scenario,
        "evaluator": sweep.evaluator,
        "set": dict(sweep.set),
        "effects": sweep.effects,
        "sign_level": sweep.sign_level,
        "any_delay": sweep.any_delay,
        "design": type(sweep.design).__name__,
        **asdict(sweep.design),
        "axes": [
            {
                "name": a.name,
                "unit": a.unit,
                "paths": list(a.paths),
                "low": a.low,
                "high": a.high,
                "scale": a.scale.value,
                "entries": [e.label if isinstance(e, Choice) else e for e in a.steps()],
            }
            for a in sweep.axes
        ],
    }
