"""Runs and files of other tools against the first of them: what was given to them, what is to be said of each."""

from collections.abc import Mapping, Sequence
from typing import Any

from attrs import field, frozen

from cosim.results.pairs import Tolerance, TracesPair
from cosim.results.traces import Traces

_SHOWN = ("scenario", "outcome", "growth_rate", "growth_rate_interval", "tracking_rmse", "limit_hit_at", "measures")


@frozen(eq=False)
class ComparedRun:
    """One of the runs: signals, summary (empty for a file of another tool), resolved start values, effects."""

    traces: Traces
    summary: Mapping[str, Any] = field(factory=dict)
    starts: Mapping[str, float | str] = field(factory=dict)


def given(runs: Sequence[ComparedRun]) -> list[tuple[str, list[Any]]]:
    """What was given to the runs and differs between them: scenario, effects, FMUs, experiment, start values."""
    rows: list[tuple[str, list[Any]]] = []
    known = [run for run in runs if run.summary]
    for key in ("scenario", "effects", "communication_step", "algorithm", "extrapolation", "seed"):
        values = [run.summary.get(key) for run in runs]
        if len({str(run.summary.get(key)) for run in known}) > 1:
            rows.append((key.replace("_", " "), values))
    for name in dict.fromkeys(name for run in known for name in run.starts):
        values = [run.starts.get(name) for run in runs]
        if len({run.starts.get(name) for run in known}) > 1:
            rows.append((name, list(values)))
    hashes = [{f["component"]: f["sha256"][:12] for f in run.summary.get("fmus", ())} for run in runs]
    for component in dict.fromkeys(c for found in hashes for c in found):
        values = [found.get(component) for found in hashes]
        if len({v for v, run in zip(values, runs) if run.summary}) > 1:
            rows.append((f"FMU of {component}", list(values)))
    return rows


@frozen(eq=False)
class RunsCompared:
    """Runs, and files of other tools, against the first of them."""

    runs: tuple[ComparedRun, ...]
    pairs: tuple[TracesPair, ...]
    tolerance: Tolerance | None = None

    @property
    def agrees(self) -> bool | None:
        """Whether all keep to the tolerance and end alike; None where no tolerance was asked for."""
        return None if self.tolerance is None else all(self._agrees(k) for k in range(len(self.pairs)))

    def _agrees(self, k: int) -> bool:
        return self.pairs[k].agrees and not self._ends_otherwise(k)

    def _ends_otherwise(self, k: int) -> str:
        """That item k + 1 has another outcome than the reference, as the end of a sentence; empty where it has not."""
        ends = [run.summary.get("outcome") for run in (self.runs[0], self.runs[k + 1])]
        return f"; it ends otherwise: {ends[1]}, not {ends[0]}" if all(ends) and ends[0] != ends[1] else ""

    def verdict(self, k: int) -> str:
        """What is to be said of item k + 1 against the reference, in a sentence."""
        found, other = self.pairs[k], self._ends_otherwise(k)
        if found.same:
            return f"the same to the last bit in {len(found.signals)} signals{other}"
        worst = found.worst
        where = f"{worst.match.name} at {worst.found.at:.6g} s"
        most = f"greatest difference {_percent(worst.share)} of its range, {where}{other}"
        if self.tolerance is None:
            return most
        if found.agrees:
            return f"within the tolerance in {len(found.signals)} signals; {most}"
        if not found.leaving:
            return f"it ends at {found.ends[1]:g} s, the reference at {found.ends[0]:g} s{other}"
        first = next((s for s in found.leaving if s.moves), found.leaving[0])
        which = "first" if first is found.leaving[0] else "first of those that vary"
        count = f"{len(found.leaving)} of {len(found.signals)} signals leave the tube"
        return f"{count}, {which} {first.match.name} at {first.found.first_outside:.6g} s; {most}"

    def to_dict(self) -> dict[str, Any]:
        """The content of compare.json."""
        tolerance = self.tolerance
        return {
            "kind": "runs",
            "items": [
                {"name": r.traces.name, **{key: r.summary[key] for key in _SHOWN if key in r.summary}}
                for r in self.runs
            ],
            "tolerance": None if tolerance is None else tolerance.relative,
            "agrees": self.agrees,
            "given": [{"what": what, "values": values} for what, values in given(self.runs)],
            "pairs": [
                {
                    "reference": found.reference.name,
                    "name": found.other.name,
                    "verdict": self.verdict(k),
                    "same_bits": found.same,
                    "agrees": None if tolerance is None else self._agrees(k),
                    "time_tolerance": found.tube_time,
                    "signals": {s.match.name: s.to_dict() for s in found.signals},
                    "notes": list(found.notes),
                }
                for k, found in enumerate(self.pairs)
            ],
        }

    def __str__(self) -> str:
        """What `cosim compare` prints."""
        width = max(len(found.other.name) for found in self.pairs)
        lines = [f"{f.other.name:<{width}}  {self.verdict(k)}" for k, f in enumerate(self.pairs)]
        notes = [f"  note: {note}" for found in self.pairs for note in found.notes]
        return "\n".join([f"reference: {self.runs[0].traces.name}", *lines, *notes])


def _percent(share: float) -> str:
    return "infinitely many times" if share == float("inf") else f"{100 * share:.3g} %"
