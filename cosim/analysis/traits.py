"""What is known of one of our arms by its parameters: its least viscosity, on the tip and in the joints."""

from functools import lru_cache

import numpy as np
from attrs import frozen

from cosim.analysis.damping import LeastViscosity, least_joint_viscosity, least_task_viscosity, least_tip_viscosity
from cosim.wiring import Wiring

_SLIDES = 3.0  # joint_type of a SerialArm


@frozen
class ArmTraits:
    """Viscosity where a controller acts, on the tip or on the joints, and whether gravity is compensated."""

    tip: LeastViscosity
    joints: LeastViscosity
    compensated: bool


def start_vector(wiring: Wiring, name: str, parameter: str) -> np.ndarray:
    """Start values of a component's vector (n,)."""
    elements = wiring.descriptions[name].elements(parameter)
    return np.array([wiring.start(name, element) for element in elements])


def arm_traits(wiring: Wiring, arm: str) -> ArmTraits:
    """Of a PhantomArm or a SerialArm."""
    viscous = start_vector(wiring, arm, "viscous")
    compensated = bool(start_vector(wiring, arm, "gravity_compensation")[0])
    if wiring.scenario.components[arm].model == "SerialArm":
        viscous = viscous[: int(wiring.start(arm, "joints"))]
        tip = least_tip_viscosity(viscous, _levers(wiring, arm, len(viscous)))
    else:
        tip = _least_task(tuple(viscous.tolist()))
    return ArmTraits(tip, least_joint_viscosity(viscous), compensated)


@lru_cache(maxsize=64)
def _least_task(viscous: tuple[float, ...]) -> LeastViscosity:
    return least_task_viscosity(np.array(viscous))


def _levers(wiring: Wiring, arm: str, joints: int) -> np.ndarray:
    """The farthest that the tip of a SerialArm can be from each joint's axis (joints,) [m]; 1 for slides."""

    def row(name: str) -> np.ndarray:
        return start_vector(wiring, arm, name)[:joints]

    slides = row("joint_type") == _SLIDES
    slack = np.maximum(np.abs(row("lower")), np.abs(row("upper")))
    slack = np.where(slides, np.where(row("lower") < row("upper"), slack, np.inf), 0.0)
    lengths = np.linalg.norm([row(f"origin_{axis}") for axis in "xyz"], axis=0)
    after = np.append((lengths + slack)[1:], np.linalg.norm(start_vector(wiring, arm, "tip")))
    return np.where(slides, 1.0, np.cumsum(after[::-1])[::-1])
