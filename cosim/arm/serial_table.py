"""The table of a serial arm as start values of the FMU SerialArm."""

from collections.abc import Callable, Sequence

import numpy as np

from cosim.arm.serial import JointKind, SerialModel, roll_pitch_yaw, turn

TYPES = ("revolute", "continuous", "prismatic")
"""Values 1, 2, 3 of the FMU's `joint_type`."""


def arm_values(model: SerialModel) -> dict[str, float | list[float]]:
    """{variable of SerialArm: start value}, one entry a joint where it is a list.

    The arm starts at `home`, ends its domain where it leaves its joint limits, and its motors give at most their
    effort.
    """
    rpy = np.array([roll_pitch_yaw(rotation) for rotation in model.rotation])
    limited = model.limited
    columns = {
        "joint_type": [TYPES.index(kind.value) + 1 for kind in model.kinds],
        **_components("origin", "xyz", model.origin),
        **_components("origin", ("roll", "pitch", "yaw"), rpy),
        **_components("axis", "xyz", model.axis),
        "mass": model.mass,
        **_components("centre", "xyz", model.centre),
        **{f"inertia_{'xyz'[i]}{'xyz'[j]}": model.inertia[:, i, j] for i in range(3) for j in range(i, 3)},
        "rotor_inertia": model.armature,
        "lower": np.where(limited, model.lower, 0.0),
        "upper": np.where(limited, model.upper, 0.0),
        "viscous": model.viscous,
        "coulomb": model.coulomb,
        "torque_saturation": np.where(np.isfinite(model.effort), model.effort, 0.0),
        "q_start": home(model),
        "gravity": model.gravity,
        "tip": model.tip,
    }
    values = {name: [float(v) for v in column] for name, column in columns.items()}
    return {"joints": float(model.count), "joint_limits": 1.0, **values}


def chain_of(start: Callable[[str], float], joints: int) -> SerialModel:
    """Where the links of an arm are, from its start values by name; its masses and limits are left out."""

    def column(name: str, part: str) -> list[float]:
        return [start(f"{name}_{part}[{i + 1}]") for i in range(joints)]

    def places(name: str, parts: Sequence[str] = "xyz") -> np.ndarray:
        return np.array([column(name, part) for part in parts]).T

    kinds = [JointKind(TYPES[round(start(f"joint_type[{i + 1}]")) - 1]) for i in range(joints)]
    nothing, zero = np.zeros((joints, 3)), np.zeros(joints)
    return SerialModel(
        name="",
        joints=[str(i + 1) for i in range(joints)],
        kinds=kinds,
        rotation=[turn(angles) for angles in places("origin", ("roll", "pitch", "yaw"))],
        origin=places("origin"),
        axis=places("axis"),
        mass=zero,
        centre=nothing,
        inertia=np.zeros((joints, 3, 3)),
        lower=zero - np.inf,
        upper=zero + np.inf,
        effort=zero + np.inf,
        speed=zero + np.inf,
        viscous=zero,
        coulomb=zero,
        armature=zero,
        tip=[start(f"tip[{i}]") for i in (1, 2, 3)],
    )


def home(model: SerialModel) -> np.ndarray:
    """Where the arm starts (n,): at zero, or in the middle of the limits where they leave zero out."""
    inside = (model.lower <= 0) & (model.upper >= 0)
    with np.errstate(invalid="ignore"):
        middle = 0.5 * (model.lower + model.upper)
    return np.where(inside, 0.0, middle)


def _components(name: str, parts, rows: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{name}_{part}": rows[:, i] for i, part in enumerate(parts)}
