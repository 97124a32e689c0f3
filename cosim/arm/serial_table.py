"""The table of a serial arm as start values of the FMU SerialArm."""

import numpy as np

from cosim.arm.serial import SerialModel, roll_pitch_yaw

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


def home(model: SerialModel) -> np.ndarray:
    """Where the arm starts (n,): at zero, or in the middle of the limits where they leave zero out."""
    inside = (model.lower <= 0) & (model.upper >= 0)
    with np.errstate(invalid="ignore"):
        middle = 0.5 * (model.lower + model.upper)
    return np.where(inside, 0.0, middle)


def _components(name: str, parts, rows: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{name}_{part}": rows[:, i] for i, part in enumerate(parts)}
