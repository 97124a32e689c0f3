"""The PHANToM Premium 1.5A in numpy: kinematics, dynamics, parameter sets, and what they say of the arm.

Written independently of the FMU PhantomArm; tests/fmu_src/test_arm_fmu.py holds the two together. MISPRINTS.md lists
where the
papers are wrong and which test shows it.
"""

from importlib import import_module

_HOMES = {
    "counterbalance": "Attachment Counterweights balancing_weights fitted",
    "dissection": "Dissection Motion dissect random_motion sampled_motion",
    "dynamics": "coriolis_matrix forward_dynamics friction_torque full_regressor gravity_torque heaviest_direction "
    "inverse_dynamics kinetic_energy mass_matrix potential_energy regressor tip_mass total_energy",
    "kinematics": "angular_jacobian forward inverse inverse_behind jacobian jacobian_rate orientation tool_jacobian",
    "parameters": "SET_NAMES Mounting ParameterSet mounted parameter_set with_payload",
    "segments": "Segment Segments point_mass_pi segment_pi",
    "workspace": "BOX LINKED Definiteness Workspace definiteness singularity",
}
_HOME = {name: module for module, names in _HOMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    """The modules and their public names, imported when they are asked for: a co-simulation needs the parameter sets
    alone.
    """
    if name in _HOMES:
        return import_module(f"{__name__}.{name}")
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
