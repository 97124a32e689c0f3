"""`stability.json`: criteria, spectrum, margins and simulation of a scenario side by side, in plain values."""

from cosim.analysis.comparison import Comparison
from cosim.analysis.coupling import CoupledSide
from cosim.analysis.criteria import Criterion
from cosim.analysis.margin import Margins
from cosim.analysis.prediction import Prediction
from cosim.results.summary import number


def document(found: Comparison) -> dict[str, object]:
    """The content of stability.json: the keys of the contract, and more. A delay without limit is null with `unbounded`
    true.
    """
    t = found.theory
    return {
        "scenario": found.judged.result.scenario.name,
        "pose": list(t.pose),
        "delays": {"mean": list(t.delays), "longest": [number(d) for d in t.longest], "constant": t.constant},
        "effective_damping": None if t.pair is None else min(float(side.effective.min()) for side in t.pair),
        "effective_damping_sides": {} if t.pair is None else {side.arm: _side(side) for side in t.pair},
        "delay_sum": _criterion(t.delay_sum),
        "sallam_eq10": _criterion(t.sallam_eq10),
        "known_mass": {"holds": t.known_mass, **_delay(t.law_bound)},
        "spectrum": {"abscissa": t.abscissa, **_delay(found.max_delay), "predicted": number(t.predicted)},
        "prediction": _prediction(t.prediction),
        "margin": _margin(found.margins),
        "passivity": {
            arm: {"passive": p.passive, "damping": p.damping, "frequency": p.frequency}
            for arm, p in found.ports.items()
        },
        "simulation": {
            "outcome": found.judged.outcome.value,
            "growth_rate": number(found.judged.growth_rate),
            "interval": None if found.judged.interval is None else [number(v) for v in found.judged.interval],
            "advice": found.judged.outcome.advice,
        },
        "any_delay": None if found.any_delay is None else found.any_delay.to_dict(),
        "falsification": None if found.falsification is None else found.falsification.to_dict(),
        "withheld": dict(t.withheld),
        "assumptions": [{"what": a.what, "holds": a.holds, "seen": a.seen} for a in t.coupled.assumptions],
        "linearised": {name: _part(found, name) for name in found.parts},
        "contradiction": found.contradiction or None,
        "evidence": found.evidence.value,
        "evidence_meaning": found.evidence.meaning,
        "added_ages": dict(found.added_ages),
        "notes": list(notes(found)),
    }


def notes(found: Comparison) -> list[str]:
    """What a reader should know before believing a number."""
    t, said = found.theory, list(found.judged.notes)
    if not t.constant:
        said.append(
            "the delay varies: the spectrum is that of the mean delay and proves "
            "nothing for the law; the criteria take its bound"
        )
    if found.contradiction:
        said.append(f"{found.contradiction}: an assumption does not hold; rely on the simulation, and report the loop")
    if t.sallam_eq10 and "delay_sum" in t.withheld:
        said.append(f"no delay-sum condition: {t.withheld['delay_sum']}")
    if t.delay_sum and t.sallam_eq10 and t.sallam_eq10.holds and not t.delay_sum.holds:
        said.append("sallam_eq10 holds where the delay-sum condition does not: it is not sufficient and proves nothing")
    if "spectrum" in t.withheld:
        said.append(f"no spectrum, margin or bound from it: {t.withheld['spectrum']}")
    elif any(part.why for part in found.parts.values()):
        said.append(
            "the spectrum is that of the map over a communication step: it holds FMUs by their answers to pulses"
        )
    if t.prediction is None:
        said.append("how well the linear loop predicts the FMUs could not be looked at")
    else:
        said.append(
            f"a run of {t.prediction.duration:g} s from a disturbed state: the linear loop misses at most "
            f"{100 * t.prediction.error:.2g} % ({t.prediction.signal})"
        )
    said += [
        f"{name}: its outputs follow {fmu.late} step{'s' * (fmu.late > 1)} ({fmu.late * fmu.step:g} s) later"
        for name, fmu in (found.stepped.fmus if found.stepped else {}).items()
        if fmu.late and found.parts[name].why
    ]
    return said


def _part(found: Comparison, name: str) -> dict[str, object]:
    """Where the equations of one FMU come from, and what its declared ones miss."""
    part, discrete = found.parts[name], found.stepped.fmus.get(name) if found.stepped else None
    realised = discrete is not None and bool(part.why)
    return {
        "from": discrete.origin if realised and discrete else part.origin,
        "misses": part.why,
        "late_steps": discrete.late if realised and discrete else 0,
        "time": "discrete" if realised else "continuous",
    }


def _prediction(prediction: Prediction | None) -> dict[str, object] | None:
    """How well the linear loop predicts a short run from a disturbed state."""
    if prediction is None:
        return None
    return {"error": number(prediction.error), "signal": prediction.signal, "duration": prediction.duration}


def _side(side: CoupledSide) -> dict[str, object]:
    unit = "N.m.s/rad" if side.joint_space else "N.s/m"
    return {
        "controller": side.damping.tolist(),
        "plant": side.viscosity.value,
        "at_pose": list(side.viscosity.pose),
        "unit": unit,
    }


def _criterion(criterion: Criterion | None) -> dict[str, object] | None:
    if criterion is None:
        return None
    return {
        "holds": criterion.holds,
        **_delay(criterion.max_delay),
        "sufficient": criterion.sufficient,
        "guarantees": criterion.guarantees,
    }


def _delay(value: float | None) -> dict[str, object]:
    return {"max_delay": number(value), "unbounded": value is not None and number(value) is None}


def _margin(margins: Margins | None) -> dict[str, object] | None:
    if margins is None:
        return None
    return {
        "gain": number(margins.gain),
        "phase_deg": number(margins.phase),
        "delay": number(margins.delay),
        "crossover": number(margins.crossover),
    }
