"""A recording from a seed: what happens, where, how much; simulated with and without it."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from tests.support.laboratory_c import files
from tests.support.laboratory_c.additions import Addition
from tests.support.laboratory_c.arrays import Array
from tests.support.laboratory_c.forms import FORMS, JOINTS, OUTSIDE, TOLD, Form, machines
from tests.support.laboratory_c.judgement import Signals, left
from tests.support.laboratory_c.likeness import alike
from tests.support.laboratory_c.logger import Logger, draw_logger, exact, logged
from tests.support.laboratory_c.outside import Unlisted
from tests.support.laboratory_c.scales import JointScales
from tests.support.laboratory_c.setup import BODIES, ExperimentPlan, Told, draw, inertias
from tests.support.laboratory_c.simulation import Plant, SimulatedRun, simulate

Kind = Literal["one", "complete", "pair", "outside"]
PILOT = 12.0
"""So much of the first run is simulated to find a size [s]."""


def experiment_runs(experiment: ExperimentPlan, additions: list[Addition], longest: float = 1e6) -> list[SimulatedRun]:
    """All runs (of a pilot: the first, cut) with additions at work."""
    body = experiment.body
    plant = Plant(body.machine, body.friction, additions, experiment.step)
    found, start = [], 0.0
    for reference in experiment.references:
        ticks = min(len(reference), int(longest / (experiment.tick * experiment.step)))
        found.append(simulate(plant, experiment.controller, reference[:ticks], experiment.tick, start))
        start += len(reference) * experiment.tick * experiment.step
        if longest < 1e6:
            break
    return found


def signals(experiment: ExperimentPlan, runs: list[SimulatedRun], additions: list[Addition]) -> list[Signals]:
    return [exact(experiment, run, additions) for run in runs]


def went_well(experiment: ExperimentPlan, runs: list[SimulatedRun]) -> bool:
    """Whether the machine followed: no number lost, no joint far out of its room."""
    for run in runs:
        if not np.isfinite(run.q).all():
            return False
        for j, room in enumerate(experiment.body.rooms):
            reach = max(np.ptp(np.concatenate([r[:, j] for r in experiment.references])), room.high - room.low)
            if np.ptp(run.q[:, j]) > 1.6 * reach:
                return False
    return True


@dataclass(frozen=True)
class Plain:
    """The experiment without anything: exact signals, and what a fit leaves of them and of the logged ones."""

    experiment: ExperimentPlan
    logger: Logger
    signals: list[Signals]
    floor: Array
    """(n,) RMS that the fit leaves of the logged signals."""
    exact: Array
    """(n,) of exact ones."""

    @property
    def weights(self) -> Array:
        return 1 / np.where(np.isfinite(self.floor), self.floor, 1.0)

    def cut(self, longest: float) -> "Plain":
        """Its pilot."""
        first = self.signals[0]
        rows = first.t < longest - 2 * self.experiment.step * self.experiment.every
        s = Signals(first.t[rows], first.q[rows], first.v[rows], first.a[rows], first.torque[rows])
        return Plain(self.experiment, self.logger, [s], self.floor, left(self.experiment, [s], self.weights))

    def added(self, runs: list[Signals], joint: int) -> float:
        """In units of the joint's noise floor."""
        there = left(self.experiment, runs, self.weights)[joint]
        return float(np.sqrt(max(there**2 - self.exact[joint] ** 2, 0.0)) / self.floor[joint])

    def shown(self, runs: list[SimulatedRun], additions: list[Addition]) -> float:
        """What additions add on their joint; endless where the machine did not follow."""
        if not went_well(self.experiment, runs):
            return np.inf
        return self.added(signals(self.experiment, runs, additions), self.experiment.joint)


class SizeSearch:
    """The next size by proportion; between the sizes that showed too little and too much, where these are known."""

    def __init__(self, target: float, most: float) -> None:
        self.target, self.most = target, most
        self.low, self.high = 0.0, np.inf

    def next(self, size: float, shown: float) -> float:
        if shown < self.target:
            self.low = max(self.low, size)
        else:
            self.high = min(self.high, size)
        wanted = size * float(np.clip(self.target / max(shown, 1e-9), 0.1, 10))
        if not self.low < wanted < self.high:
            wanted = (self.low + self.high) / 2 if np.isfinite(self.high) else self.most
        return min(wanted, self.most)


def plain(rng: np.random.Generator, experiment: ExperimentPlan) -> Plain:
    exact_signals = signals(experiment, experiment_runs(experiment, []), [])
    logger = draw_logger(rng, exact_signals)
    student = [logged(experiment, logger, s, k).filtered for k, s in enumerate(exact_signals)]
    floor = left(experiment, student)
    weights = 1 / np.where(np.isfinite(floor), floor, 1.0)
    return Plain(experiment, logger, exact_signals, floor, left(experiment, exact_signals, weights))


def scene(rng: np.random.Generator, without: Plain) -> JointScales:
    experiment, j = without.experiment, without.experiment.joint
    q, v, torque = (np.concatenate([getattr(s, word) for s in without.signals]) for word in ("q", "v", "torque"))
    friction = experiment.body.friction
    return JointScales(rng, experiment.body.machine, j, q, v, torque, friction.dry[j], friction.viscous[j],
                 inertias(experiment.body)[j], experiment.duration)  # fmt: skip


def sized(without: Plain, addition: Addition, target: float) -> None:
    """Changes the size until a pilot shows about what is asked, or the size is at its limit."""
    by_time = {"time", "time at rest"} & set(addition.depends) or addition.name == "friction_drift"
    longest = 1e6 if by_time else PILOT
    pilot = without if by_time else without.cut(PILOT)
    search = SizeSearch(target, addition.most)
    for _ in range(3):
        runs = experiment_runs(without.experiment, [addition], longest)
        shown = pilot.shown(runs, [addition])
        if 0.75 < shown / target < 1.4:
            return
        addition.size = search.next(addition.size, shown)


@dataclass(frozen=True)
class DrawnRecording:
    """One experiment with what happened in it; `shows` and `alike` are told from exact signals."""

    without: Plain
    additions: list[Addition]
    runs: list[SimulatedRun]
    signals: list[Signals]
    seed: int
    kind: Kind

    @cached_property
    def shows(self) -> float:
        """RMS that all additions add to the residual, over the noise floor."""
        return self.without.added(self.signals, self.without.experiment.joint) if self.additions else 0.0

    @cached_property
    def alone(self) -> list[list[Signals]]:
        """Exact signals of the experiment with each addition alone."""
        e = self.without.experiment
        if len(self.additions) == 1:
            return [self.signals]
        return [signals(e, experiment_runs(e, [a]), [a]) for a in self.additions]

    @cached_property
    def shows_each(self) -> dict[str, float]:
        j = self.without.experiment.joint
        return {word(a): self.without.added(s, j) for a, s in zip(self.additions, self.alone, strict=True)}

    @cached_property
    def alike(self) -> list[str]:
        found, e, weights = set[str](), self.without.experiment, self.without.weights
        for addition, mine in zip(self.additions, self.alone, strict=True):
            rest = float(self.without.exact[e.joint] * weights[e.joint])
            found |= set(alike(e, mine, weights, e.joint, addition.name, rest))
        return sorted(found - {a.name for a in self.additions})

    def truth(self) -> dict:
        e, names = self.without.experiment, [a.name for a in self.additions]
        described = e.joint + 1 if e.told == "robot" else 1
        linear = e.body.linear[e.joint]
        unit = "N" if linear else "N m"
        prefix = (lambda a: f"{a.name}: ") if len(names) > 1 else lambda a: ""
        return {
            "phenomena": names,
            "joints": [described] * len(names),
            "depends_on": sorted({signal for a in self.additions for signal in a.depends}),
            "parameters": {f"{prefix(a)}{k}": x for a in self.additions for k, x in a.parameters().items()},
            "form": "; ".join(a.form for a in self.additions) or "nothing special",
            "shows": round(self.shows, 4),
            "shows_each": {k: round(x, 4) for k, x in self.shows_each.items()} if names else {},
            "alike": self.alike if names else [],
            "floor": f"{self.without.floor[e.joint]:.6g} {unit}",
            "kind": self.kind,
            "seed": self.seed,
            "machine": e.body.word,
            "described_as": e.told,
            "described_joint": e.joint + 1,
            "nominal": {
                "dry friction": f"{e.body.friction.dry[e.joint]:.6g} {unit}",
                "viscous": f"{e.body.friction.viscous[e.joint]:.6g} {unit} s/{'m' if linear else 'rad'}",
            },
            "motions": list(e.motions),
            "rate": f"{e.rate:g} Hz",
        }

    def write(self, folder: Path) -> None:
        """data.csv, data.toml (and arm.urdf) for the tool; truth.json for the judge."""
        folder.mkdir(parents=True, exist_ok=True)
        e = self.without.experiment
        rows = [logged(e, self.without.logger, s, k) for k, s in enumerate(self.signals)]
        writer = {"axis": files.axis, "robot": files.robot}.get(e.told, files.regressor)
        columns, description = writer(e, self.without.logger, rows, self._extra())
        files.write_table(folder / "data.csv", columns)
        (folder / "data.toml").write_text(description, encoding="utf-8")
        if e.told == "robot":
            (folder / "arm.urdf").write_text(files.urdf(e), encoding="utf-8")
        (folder / "truth.json").write_text(json.dumps(self.truth(), indent=1), encoding="utf-8")

    def _extra(self) -> files.Extra:
        logs = [a for a in self.additions if isinstance(a, Unlisted) and a.logs]
        times = np.concatenate([s.t for s in self.signals])
        found: files.Extra = {}
        for a in logs:
            found["t_room"] = ("degC", np.round(21 + 1.5 * np.array([a.cause(t) for t in times.tolist()]), 3))
        return found


def word(addition: Addition) -> str:
    return f"unknown:{type(addition).__name__}" if addition.name == "unknown" else addition.name


def drawn_forms(rng: np.random.Generator, kind: Kind, phenomenon: str | None) -> list[tuple[str, Form]]:
    """Names and forms: none, one, two of different names, or one that is in no list."""
    if kind == "complete":
        return []
    if kind == "outside":
        named = [f for f in OUTSIDE if f.__name__ == phenomenon] or list(OUTSIDE)
        return [("unknown", named[int(rng.integers(len(named)))])]
    names = [str(x) for x in rng.choice(list(FORMS), 2 if kind == "pair" else 1, replace=False)]
    if phenomenon:
        names = [phenomenon, *[n for n in names if n != phenomenon][: len(names) - 1]]
    return [(name, FORMS[name][int(rng.integers(len(FORMS[name])))]) for name in names]


def possible(forms: list[tuple[str, Form]], machine: str | None) -> list[str]:
    found = [m for m in BODIES if all(m in machines(name, form) for name, form in forms)]
    gears = sum(name in ("joint_elasticity", "backlash") for name, _ in forms)
    return [m for m in found if machine in (None, m)] if gears < 2 else []


def place(
    rng: np.random.Generator, forms: list[tuple[str, Form]], machine: str | None, longest: float
) -> ExperimentPlan:
    """An experiment in which all of them can be seen."""
    which = str(rng.choice(possible(forms, machine)))
    body = BODIES[which](rng)
    joints = set(range(len(body.rooms)))
    for name, _ in forms:
        joints &= set(JOINTS.get(name, {}).get(which, joints))
    rigid = any(TOLD.get(form) for _, form in forms) or rng.random() < 0.25
    mounted = {name for name, _ in forms} & {"base_tilt", "encoder_offset"}
    told: Told = "regressor"
    if len(body.rooms) == 1:
        told = "axis"
    elif which == "arm":
        told = "robot"
    elif rigid and not mounted:
        told = "rigid"
    return draw(rng, body, told, int(rng.choice(sorted(joints))), longest)


def generate(seed: int, kind: Kind = "one", phenomenon: str | None = None, strength: float | None = None,
             longest: float = 60.0, machine: str | None = None) -> DrawnRecording:  # fmt: skip
    """A recording by its seed; `strength` asks for a value of `shows`, `longest` [s] and `machine` limit the draw."""
    rng = np.random.default_rng([seed, ("one", "complete", "pair", "outside").index(kind), 77003])
    forms = drawn_forms(rng, kind, phenomenon)
    while not possible(forms, machine):
        forms = drawn_forms(rng, kind, phenomenon)
    without = plain(rng, place(rng, forms, machine, longest))
    about = scene(rng, without)
    additions = [form(about) for _, form in forms]
    targets = [strength or float(np.exp(rng.uniform(np.log(0.5), np.log(10)))) for _ in additions]
    for addition, target in zip(additions, targets, strict=True):
        sized(without, addition, target)
    runs = finished(without, additions, targets)
    return DrawnRecording(without, additions, runs, signals(without.experiment, runs, additions), seed, kind)


def finished(without: Plain, additions: list[Addition], targets: list[float]) -> list[SimulatedRun]:
    """All runs; where the machine does not follow, or one addition shows far from what is asked, with other sizes."""
    e, search = without.experiment, SizeSearch(targets[0] if targets else 0.0, additions[0].most if additions else 0.0)
    for _ in range(5 if len(additions) == 1 else 0):
        runs, before = experiment_runs(e, additions), additions[0].size
        shown = without.shown(runs, additions)
        if 0.5 < shown / targets[0] < 2:
            return runs
        additions[0].size = search.next(before, shown)
        if additions[0].size == before:
            return runs
    while True:
        runs = experiment_runs(e, additions)
        if went_well(e, runs):
            return runs
        for addition in additions:
            addition.size *= 0.6
