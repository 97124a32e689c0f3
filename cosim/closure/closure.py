"""The loop closed with measured data: from a recording to a verdict with its evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, field, frozen

from cosim.closure.drive import StartValues, drive_of
from cosim.closure.fitted import effect_values, start_values
from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.model import Model, complete, with_choices
from cosim.closure.model.motion import SmoothedMotion, prepare, thinned
from cosim.closure.model.setting import formulate
from cosim.closure.refusal import Refusal, circular, hidden, motion_refusals
from cosim.closure.score.checks import incomplete, surprising, unseparated
from cosim.closure.score.compare import reported
from cosim.closure.score.errors import TorqueError, torque_error
from cosim.closure.score.floor import floor
from cosim.closure.score.search import MOST, EffectSearch, resettled, search
from cosim.closure.verdict import Answer, ClosureVerdict, NamedEffect, closest, judge
from cosim.effects import Effect, library
from cosim.effects.constants import HALF
from cosim.errors import InputError, Problem
from cosim.measured import Recording
from cosim.measured.rates import at_one_rate

if TYPE_CHECKING:
    from cosim.closure.replay import Replay
    from cosim.closure.simulation import FreeSimulation
    from cosim.closure.table import CarriedTable


@frozen
class Options:
    """The effects to look for, those of an earlier pass, how many to add at most, whether to replay, and a function
    that is called with what is being done.
    """

    effects: tuple[Effect, ...] = field(factory=library)
    most: int = MOST
    previous: tuple[ChosenEffect, ...] = ()
    replayed: bool = True
    progress: Callable[[str], None] = lambda text: None


@frozen(eq=False)
class Closure:
    """Everything that was found.

    before: the model at the start, with the effects of an earlier pass, None where refused early. values_before,
    values_after: start values of the device's FMU with either model, effect_values those of the effects alone; table:
    what became of a torque over the position without a name, None where none was left.
    """

    recording: Recording
    verdict: ClosureVerdict
    before: Model | None = None
    search: EffectSearch | None = None
    error: TorqueError | None = None
    floor: tuple[float | None, ...] = ()
    replay: Replay | None = None
    simulation: FreeSimulation | None = None
    table: CarriedTable | None = None
    values_before: StartValues = field(factory=dict)
    values_after: StartValues = field(factory=dict)
    effect_values: StartValues = field(factory=dict)
    warnings: tuple[str, ...] = ()


def close_loop(recording: Recording, options: Options = Options()) -> Closure:
    """Find the effects that the complete model lacks, add them, compare held-out errors before and after.

    Its matrices have few columns: more threads of the linear algebra than one wait for each other.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        return _closed(recording, options)


def _closed(recording: Recording, options: Options) -> Closure:
    progress = options.progress
    progress("smoothing and differentiating")
    recording = at_one_rate(_unloaded(recording))
    motion = prepare(recording)
    rows = thinned(motion)
    refusals = motion_refusals(motion, rows)
    if any(r.joint == 0 for r in refusals):
        return _refused(recording, refusals)
    progress("fitting the complete model")
    before = complete(formulate(recording, motion, rows))
    refusals += circular(before)
    if refusals:
        return _refused(recording, refusals, before)
    if options.previous:
        before = resettled(with_choices(before, options.previous))
    progress("searching for missing effects")
    found = search(before, options.effects, options.most, progress)
    verdict = _judged(found, options)
    gone = [(c, why) for c, why in verdict.withdrawn if found.few and c.key == found.few.key]
    if gone and found.firm:
        found = found.firm
        verdict = _judged(found, options)
        verdict = evolve(verdict, withdrawn=(*verdict.withdrawn, *gone))
    before.formed.forget()
    unseen = hidden(motion, rows)
    if unseen and verdict.answer is Answer.COMPLETE:
        return _refused(recording, unseen, before)
    told = (f"joint {r.joint} is not judged: {r.reason}" for r in unseen)
    return _completed(recording, found, evolve(verdict, warnings=(*verdict.warnings, *told)), options)


def _judged(found: EffectSearch, options: Options) -> ClosureVerdict:
    """The verdict of the fitted rows without what the report contradicts. Here the rows of the report are looked at,
    when all is chosen: they can only take away.
    """
    verdict = judge(found, options.effects, options.progress)
    return _no_worse(verdict, evolve(found.before, tangents=False), options.effects)


def _unloaded(recording: Recording) -> Recording:
    """The recording, where nothing was mounted that only the linear model of an identification knows."""
    if any(run.load is not None for run in recording.runs) or recording.description.back_emf:
        advice = "identify takes them; for close-loop leave them out of the description"
        raise InputError(Problem("[mounted], [motor]", "a bare joint", "known loads or a back-EMF", advice))
    return recording


def _refused(recording: Recording, refusals: Sequence[Refusal], before: Model | None = None) -> Closure:
    texts = tuple(f"joint {r.joint}: {r.reason}" if r.joint else r.reason for r in refusals)
    return Closure(
        recording, ClosureVerdict(Answer.REFUSED, warnings=texts), before, warnings=(*texts, *recording.warnings)
    )


def _completed(recording: Recording, found: EffectSearch, verdict: ClosureVerdict, options: Options) -> Closure:
    """The closure of a verdict, with its errors on the rows of the report."""
    before = evolve(found.before, tangents=False)
    table = _carried(recording, verdict, options) if options.replayed else None
    if table is not None and table.taken:
        from cosim.closure.table import with_table

        verdict = with_table(verdict, table)
    model, best = verdict.models()
    closure = Closure(
        recording,
        verdict,
        before,
        found,
        torque_error(before, best),
        floor(before),
        values_before=start_values(recording, before),
        values_after=start_values(recording, model),
        effect_values=effect_values(recording, model),
        table=table,
        warnings=(*recording.warnings, *_warnings(before, verdict), *_ended(found), *_left(table)),
    )
    return _replayed(closure, options) if options.replayed else closure


def _no_worse(verdict: ClosureVerdict, before: Model, effects: Sequence[Effect]) -> ClosureVerdict:
    """The verdict without what the rows of the report contradict: a smooth correction that makes them worse; names with
    which their error does not fall and their blocks, each with a noise level of its own, are told no better, or leave
    more than fitted rows let expect; names on a model that explains less than half of the torque. What the fitted rows
    show in the place of such names is told without a name.
    """
    model, best = verdict.models()
    if _worse(torque_error(model, best), {x.joint for x in verdict.leftovers}):
        verdict = evolve(verdict, best=model)
    new = tuple(f for f in verdict.findings if not f.earlier)
    joints = {j for f in new for j in f.acting}
    text, risen = "", bool(joints) and _worse(torque_error(before, model), joints)
    if risen and (reported(model, before, tuple(sorted(joints))) <= 0 or joints & surprising(model)):
        text = "rows of the report are no better with it"
    error = torque_error(before, verdict.models()[1])
    least = min((e for e in (*error.before, *error.after) if np.isfinite(e)), default=0.0)
    poor = least > 100 * HALF
    if poor:
        text = f"the model explains less than half of the torque (RMS error {least:.0f} %): no effect can be named"
    if not text:
        why = ("the error of the reported rows does not fall with it",) if risen else ()
        doubted = (f if f.earlier else evolve(f, doubts=(*f.doubts, *why)) for f in verdict.findings)
        return evolve(verdict, findings=tuple(doubted))
    answer = Answer.UNEXPLAINED if poor or new or verdict.leftovers or incomplete(before) else Answer.COMPLETE
    alone = joints - {x.joint for x in verdict.leftovers}
    left = () if poor else closest(before, tuple(sorted(alone)), effects)
    return evolve(
        verdict,
        answer=answer,
        leftovers=(*verdict.leftovers, *left),
        findings=() if poor else tuple(f for f in verdict.findings if f.earlier),
        withdrawn=(*verdict.withdrawn, *((f.choice, text) for f in (verdict.findings if poor else new))),
        model=before,
        best=before,
        warnings=(*verdict.warnings, text) if poor else verdict.warnings,
    )


def _carried(recording: Recording, verdict: ClosureVerdict, options: Options) -> CarriedTable | None:
    """The torque over the position that the FMU may carry; not taken where rows of the report contradict it."""
    from cosim.closure.table import carried_table

    table = carried_table(recording, verdict, options.progress)
    if table is None or not table.taken or not _worse(torque_error(verdict.models()[0], table.model), {0}):
        return table
    return evolve(table, taken=False, why="rows of the report are no better with a torque over the position in the FMU")


def _left(table: CarriedTable | None) -> list[str]:
    return [] if table is None or table.taken else [table.why]


def _worse(error: TorqueError, joints: set[int]) -> bool:
    """Whether the mean ratio of after to before over the joints is above one, with reversals and without."""
    moving = [j for j in joints if np.isfinite(error.before[j])]
    pairs = ((error.before, error.after), (error.all_before, error.all_after))
    return bool(moving) and all(
        np.mean([after[j] / max(before[j], 1e-12) for j in moving]) > 1 for before, after in pairs
    )


def _warnings(before: Model, verdict: ClosureVerdict) -> list[str]:
    out = list(verdict.warnings)
    out += [
        f"{c.effect.name} on joint(s) {', '.join(str(j + 1) for j in c.joints)} was withdrawn: {why}"
        for c, why in verdict.withdrawn
    ]
    motion, rows = before.setting.motion, before.setting.rows
    share = 1 - rows.moving.mean(axis=0)
    out += [
        f"joint {j + 1}: {100 * s:.0f} % of the rows are near a standstill or a reversal and were left out of the fit"
        for j, s in enumerate(share)
        if s > 0.3
    ]
    if before.skew > 0:
        out.append(
            f"the recorded torque acts {1e3 * before.skew:.3g} ms late "
            f"({before.skew / motion.sample:.2g} samples): taken as sampling; "
            "a lag of the drive as short would look the same"
        )
    out += [*_range_warnings(motion), *unseparated(before)]
    out += [f"{e.run}, {e.time:.3f} s, joint {e.joint + 1}: {e.kind}" for e in verdict.events]
    out += [
        f"{f.name} on joint(s) {', '.join(map(str, f.joints))}: this form of it is in no FMU, the FMU after lacks it"
        for f in verdict.findings
        if f.parameters and not any(label.index or label.name.isidentifier() for label in f.parameters)
    ]
    drive = drive_of(before.setting.device)
    if drive is not None and (text := drive.lacks(label for f in verdict.findings for label in f.parameters)):
        out.append(text)
    lags = [f for f in verdict.findings if f.name in ("actuator_lag", "time_delay")]
    if lags:
        out.append(
            "a lag estimated from sampled rows holds the half sample of the "
            "held torque, which a co-simulation has by itself: "
            f"the replay uses it less {500 * motion.sample:.2g} ms"
        )
    return out


def _ended(found: EffectSearch) -> list[str]:
    """Whether the search was ended while it still found something."""
    if not found.steps or found.steps[-1].taken is None:
        return []
    return [
        f"the search ended after {len(found.steps)} rounds, the last of which still found an effect: "
        "another pass that starts from this one's effects.toml goes on"
    ]


def _range_warnings(motion: SmoothedMotion) -> list[str]:
    """Held-out rows that are faster than the fitted rows; positions are compared where the recording is read."""
    fitted, held = np.abs(motion.dq[~motion.test]), np.abs(motion.dq[motion.test])
    if not len(held):
        return []
    share = 100 * (held > 1.01 * fitted.max(axis=0)).mean(axis=0)
    beyond = [f"joint {j + 1} {s:.3g} %" for j, s in enumerate(share) if s > 0.5]
    return [f"held-out rows are faster than any fitted one: {', '.join(beyond)}"] if beyond else []


def _replayed(closure: Closure, options: Options) -> Closure:
    """The recorded experiment as a co-simulation with both FMUs; a replay that fails is a warning."""
    if closure.before is None or drive_of(closure.recording.device) is None:
        return closure
    options.progress("replaying the experiment with both FMUs")
    from cosim.closure.replay import replay, without_hold
    from cosim.closure.simulation import simulate
    from cosim.errors import InputError, RunError

    motion = closure.before.setting.motion
    sides = [without_hold(values, motion.sample) for values in (closure.values_before, closure.values_after)]
    closure = evolve(closure, simulation=simulate(closure.recording, *sides))
    try:
        result = replay(closure.recording, sides[0], sides[1], motion.widths.total)
    except (InputError, RunError) as error:
        return evolve(closure, warnings=(*closure.warnings, f"no replay: {error}"))
    if result is None:
        return closure
    findings = tuple(evolve(f, doubts=(*f.doubts, *result.doubts)) for f in closure.verdict.findings)
    verdict = evolve(closure.verdict, findings=findings)
    return evolve(closure, verdict=verdict, replay=result, warnings=(*closure.warnings, *result.warnings))


__all__ = ["Answer", "Closure", "NamedEffect", "Options", "close_loop"]
