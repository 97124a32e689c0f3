"""The schedule of a master algorithm: what is set, stepped, read and recorded, in which order, apart from who executes
it.

Every output of every component has a place in `store[0:n]`, its value one step of its component before in
`store[n:2n]`. A schedule repeats after `len(phases)` communication steps (the least common multiple of the components'
step multiples). Executors (`cosim.engine.master`, a compiled one) run the same operations and so give the same bits.

Which value an input sees in the communication step from t_n to t_n+1 (step multiples k, producer p, consumer c;
`newest` is the time of the newest value that p has delivered, `older` the one before, both in steps):

- Jacobi: all inputs are set before any component steps, so newest <= n.
- Gauss-Seidel: components step one after another; p ahead of c in the order has delivered newest = n + k_p already.
- hold: u = newest value (the older one where newest lies beyond the end of c's own step).
- linear: u(t) runs along the line through both values: extrapolation for newest <= n, interpolation for newest > n.
"""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from attrs import cmp_using, field, frozen
from numpy.typing import ArrayLike

from cosim.scenario import Algorithm


def _indices(values: ArrayLike) -> np.ndarray:
    return np.asarray(values, dtype=np.int64)


def _numbers(values: ArrayLike) -> np.ndarray:
    return np.asarray(values, dtype=float)


def _nothing() -> np.ndarray:
    return np.zeros(0)


_BY_VALUE = cmp_using(np.array_equal)


@frozen
class SetInputs:
    """inputs[:] = store[source], then along lines: inputs[line] += weight (store[newer] - store[older]) where weight !=
    0, slopes[:] = (store[newer] - store[older]) / span for the inputs on lines; the others are held. At last
    inputs[scaled] = gain inputs[scaled] + shift, where units are turned into each other.

    source: (inputs,) places in the store; line: (lines,) places among the inputs; newer, older: (lines,) places in the
    store; weight: (lines,) [1]; span: (lines,) [s], divided by the gain; scaled: places among the inputs.
    """

    component: int
    source: np.ndarray = field(converter=_indices, eq=_BY_VALUE)
    line: np.ndarray = field(converter=_indices, eq=_BY_VALUE)
    newer: np.ndarray = field(converter=_indices, eq=_BY_VALUE)
    older: np.ndarray = field(converter=_indices, eq=_BY_VALUE)
    weight: np.ndarray = field(converter=_numbers, eq=_BY_VALUE)
    span: np.ndarray = field(converter=_numbers, eq=_BY_VALUE)
    scaled: np.ndarray = field(factory=_nothing, converter=_indices, eq=_BY_VALUE)
    gain: np.ndarray = field(factory=_nothing, converter=_numbers, eq=_BY_VALUE)
    shift: np.ndarray = field(factory=_nothing, converter=_numbers, eq=_BY_VALUE)


@frozen
class Step:
    """doStep of one component from the current communication point over `multiple` communication steps."""

    component: int
    multiple: int


@frozen
class GetOutputs:
    """The component's part of store[n:2n] takes the values of store[0:n], which takes the component's outputs."""

    component: int


@frozen
class Record:
    """The row of a communication point: store[source], source (signals,) places."""

    source: np.ndarray = field(converter=_indices, eq=_BY_VALUE)


@frozen
class CarryTexts:
    """The texts and bytes that are wired to a component are handed over as their producers have them now."""

    component: int


Operation = SetInputs | Step | GetOutputs | CarryTexts


@frozen
class Phase:
    """One communication step: operations in order, then the row that is recorded at its end (if it is its turn)."""

    operations: tuple[Operation, ...]
    record: Record


@frozen
class Schedule:
    """Phases to repeat, where each component's outputs lie in the store, and the communication step in nanoseconds.

    components: names; offset[i], count[i]: place and number of component i's outputs.
    """

    components: tuple[str, ...]
    offset: tuple[int, ...]
    count: tuple[int, ...]
    phases: tuple[Phase, ...]
    step_ns: int

    @property
    def outputs(self) -> int:
        """Number of outputs n of all components; the store holds 2n values."""
        return sum(self.count)

    @property
    def remembered(self) -> tuple[int, ...]:
        """Components whose previous outputs are read, for a line, for a value held longer, or for a row."""
        read = [
            x
            for phase in self.phases
            for o in phase.operations
            if isinstance(o, SetInputs)
            for x in (o.source, o.newer, o.older)
        ]
        places = np.concatenate([*read, *(phase.record.source for phase in self.phases)])
        past = np.searchsorted(np.cumsum(self.count), places[places >= self.outputs] - self.outputs, side="right")
        return tuple(sorted(set(past.tolist())))


@frozen
class Port:
    """A wired input: where its value comes from, whether it may move along a line, how its unit is turned into the
    input's.
    """

    producer: int
    place: int
    linear: bool
    gain: float = 1.0
    shift: float = 0.0


@frozen
class ScheduledComponent:
    """A component as the schedule sees it: step multiple, number of outputs, ports of its wired inputs in order."""

    name: str
    multiple: int
    outputs: int
    ports: tuple[Port, ...]
    texts: bool = False


@frozen
class Timing:
    """Times of the two values that a consumer may use when it steps from n, in communication steps."""

    now: int
    newest: int
    older: int
    held: int

    @classmethod
    def of(
        cls, algorithm: Algorithm, now: int, producer: ScheduledComponent, consumer: ScheduledComponent, ahead: bool
    ) -> "Timing":
        """Timing of a hop in the step from `now`; `ahead` says whether the producer comes first in the order."""
        begun = now - now % producer.multiple
        delivered = algorithm is Algorithm.GAUSS_SEIDEL and (ahead or begun < now)
        newest = begun + producer.multiple if delivered else begun
        older = newest - producer.multiple
        return cls(now, newest, older, newest if newest <= now + consumer.multiple else older)


def build_schedule(
    units: Sequence[ScheduledComponent], order: Sequence[int], algorithm: Algorithm, step_ns: int
) -> Schedule:
    """The schedule of the given components, stepped in `order` (indices; Gauss-Seidel) or all at once (Jacobi)."""
    count = tuple(unit.outputs for unit in units)
    offset = tuple(int(v) for v in np.concatenate([[0], np.cumsum(count)[:-1]])) if units else ()
    builder = _Builder(tuple(units), tuple(order), algorithm, offset, sum(count), step_ns)
    period = math.lcm(*(unit.multiple for unit in units)) if units else 1
    return Schedule(
        tuple(u.name for u in units), offset, count, tuple(builder.phase(n) for n in range(period)), step_ns
    )


@frozen
class _Builder:
    units: tuple[ScheduledComponent, ...]
    order: tuple[int, ...]
    algorithm: Algorithm
    offset: tuple[int, ...]
    total: int
    step_ns: int

    def phase(self, now: int) -> Phase:
        due = [i for i in self.order if now % self.units[i].multiple == 0]
        if self.algorithm is Algorithm.JACOBI:
            done = [i for i in self.order if (now + 1) % self.units[i].multiple == 0]
            operations = [self._set(i, now) for i in due] + [self._carry(i) for i in due]
            operations += [self._step(i) for i in due] + [GetOutputs(i) for i in done]
        else:
            operations = [op for i in due for op in (self._set(i, now), self._carry(i), self._step(i), GetOutputs(i))]
        return Phase(tuple(op for op in operations if op is not None), self._record(now + 1))

    def _step(self, i: int) -> Step:
        return Step(i, self.units[i].multiple)

    def _carry(self, i: int) -> CarryTexts | None:
        return CarryTexts(i) if self.units[i].texts else None

    def _set(self, i: int, now: int) -> SetInputs | None:
        unit, rank = self.units[i], {c: r for r, c in enumerate(self.order)}
        if not unit.ports:
            return None
        source, lines = [], []
        for place, port in enumerate(unit.ports):
            producer = self.units[port.producer]
            timing = Timing.of(self.algorithm, now, producer, unit, rank[port.producer] < rank[i])
            newer, older = port.place, port.place + self.total
            if not port.linear:
                source.append(newer if timing.held == timing.newest else older)
                continue
            source.append(newer if timing.newest == now else older)
            inside = timing.newest != now and timing.older != now
            weight = (now - timing.older) / producer.multiple if inside else 0.0
            lines.append((place, newer, older, weight, producer.multiple * self.step_ns / 1e9 / port.gain))
        columns = list(zip(*lines)) if lines else [()] * 5
        scaled = [(k, p.gain, p.shift) for k, p in enumerate(unit.ports) if (p.gain, p.shift) != (1.0, 0.0)]
        return SetInputs(i, source, *columns, *(zip(*scaled) if scaled else ()))

    def _record(self, at: int) -> Record:
        """Places of the newest values that are not ahead of the communication point `at`."""
        source = []
        for i, unit in enumerate(self.units):
            ahead = self.algorithm is Algorithm.GAUSS_SEIDEL and at % unit.multiple != 0
            shift = self.total if ahead else 0
            source += [self.offset[i] + j + shift for j in range(unit.outputs)]
        return Record(source)


def mean_age(
    algorithm: Algorithm, producer: ScheduledComponent, consumer: ScheduledComponent, ahead: bool, integrates: bool
) -> Fraction:
    """Mean age of a held input over the consumer's steps, in communication steps: when it acts, less when it was so.

    A sampled consumer acts at the end of its step of k_c; an integrating one throughout it, on average in its middle. A
    value of time `held` therefore has the age now + k_c - held, or now + k_c/2 - held. With equal step multiples:
    Jacobi 1 and 1/2, Gauss-Seidel behind its producer 0 and -1/2. To first order in the step a loop cannot tell this
    age from a delay; an input on a line has none (its error is of second order).
    """
    return chain_age(algorithm, (producer, consumer), (ahead,), integrates)


def chain_age(
    algorithm: Algorithm, chain: Sequence[ScheduledComponent], ahead: Sequence[bool], integrates: bool
) -> Fraction:
    """Mean age of a signal that is held from component to component, in communication steps; exact for all multiples.

    `ahead[i]`: chain[i] steps before chain[i + 1]. Each value is followed back: the last component's step from
    `now` uses a value that its producer gave at the time `held`, computed in the step from held - k, and so on. (The
    ages of single hops add up to this where all multiples are equal; else it matters which values are passed on.)
    """
    last = chain[-1].multiple
    acts = Fraction(last, 2) if integrates else Fraction(last)
    starts = range(0, math.lcm(*(unit.multiple for unit in chain)), last)
    total = Fraction(0)
    for start in starts:
        now = held = start
        for i in range(len(chain) - 1, 0, -1):
            held = Timing.of(algorithm, now, chain[i - 1], chain[i], ahead[i - 1]).held
            now = held - chain[i - 1].multiple
        total += start + acts - held
    return total / len(starts)


def seconds(steps: int, step_ns: int) -> float:
    """The communication point after a number of steps [s], the double nearest to its exact value."""
    return steps * step_ns / 1_000_000_000
