"""The gain ladder of Taati 4.3: up to which gains does inverse dynamics control stay stable, with which parameters?

Each rung is a co-simulation of scenario `inverse-dynamics` with the loop's delay of a real rig (the arm's
`time_delay`), at Kd = 2 zeta sqrt(Kp). The two loops of the scenario are run apart, so that one that leaves its domain
does not end the other. A rung holds where the arm stays in its domain and has come to rest at the end of every half
pulse.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from cosim.engine.master import Result, System, run
from cosim.engine.outcome import Outcome
from cosim.fmu import open_system
from cosim.scenario import Scenario, load_scenario

GAINS = (
    100.0,
    225.0,
    400.0,
    625.0,
    900.0,
    1200.0,
    1600.0,
    2000.0,
    2500.0,
    3200.0,
    4000.0,
)  # 1/s^2; the paper's end at 1200
REST = 0.05  # rad/s rms over LATE
PULSE, LATE = 2.0, (1.6, 1.98)  # s: period of half pulses in the scenario, and the end of one, before the next begins


@frozen
class Rung:
    """One gain with one parameter set: proportional, derivative gains, whether it held, RMS error of each joint
    [rad].
    """

    parameters: str
    proportional: float
    derivative: float
    held: bool
    error: tuple[float, float, float]


def gain_ladder(
    parameters: str,
    configuration: str = "UR",
    delay: float = 0.012,
    damping: float = 1.15,
    gains: Sequence[float] = GAINS,
) -> list[Rung]:
    """Climb until a rung does not hold, the controller holding `parameters`, the plant being `configuration`."""
    scenario = load_scenario("inverse-dynamics").with_values(
        {
            "arm*.parameter_set": configuration,
            "controller*.parameter_set": parameters,
            "arm*.time_delay": delay,
            "excitation.square_amplitude": [0.1, 0.05, 0.1],
        }
    )
    rungs: list[Rung] = []
    with open_system(scenario) as system:
        for gain in gains:
            rungs.append(_rung(scenario, system, parameters, gain, 2 * damping * np.sqrt(gain)))
            if not rungs[-1].held:
                break
    return rungs


def limit(rungs: Sequence[Rung]) -> float:
    """The largest proportional gain that held, 0 if none did."""
    return max((rung.proportional for rung in rungs if rung.held), default=0.0)


def _rung(scenario: Scenario, system: System, parameters: str, gain: float, rate: float) -> Rung:
    gains = {"controller*.proportional_gain": float(gain), "controller*.derivative_gain": float(rate)}
    result = run(scenario.with_values(gains), system, record=["arm.q", "arm.dq", "excitation.q_ref"])
    error = result.vector("arm.q") - result.vector("excitation.q_ref")
    rms = np.sqrt(np.nanmean(error**2, axis=0))
    return Rung(parameters, float(gain), float(rate), _held(result), tuple(rms.tolist()))


def _held(result: Result) -> bool:
    if result.outcome in (Outcome.DOMAIN_EXIT, Outcome.DIVERGED, Outcome.FAILED):
        return False
    phase = np.mod(result.time, PULSE)
    late = (phase > LATE[0]) & (phase < LATE[1])
    return bool(np.sqrt((result.vector("arm.dq")[late] ** 2).mean(axis=0)).max() < REST)
