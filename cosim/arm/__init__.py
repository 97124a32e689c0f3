"""The PHANToM Premium 1.5A in numpy: kinematics, dynamics, parameter sets, and what they say of the arm.

Written independently of the FMU PhantomArm; tests/test_arm_fmu.py holds the two together. MISPRINTS.md lists where the
papers are wrong and which test shows it.
"""

from cosim.arm.counterbalance import Attachment, Counterweights, balancing_weights, fitted
from cosim.arm.dissection import Dissection, Motion, dissect, random_motion, sampled_motion
from cosim.arm.dynamics import (
    coriolis_matrix,
    forward_dynamics,
    friction_torque,
    full_regressor,
    gravity_torque,
    heaviest_direction,
    inverse_dynamics,
    kinetic_energy,
    mass_matrix,
    potential_energy,
    regressor,
    tip_mass,
    total_energy,
)
from cosim.arm.kinematics import (
    angular_jacobian,
    forward,
    inverse,
    inverse_behind,
    jacobian,
    jacobian_rate,
    orientation,
    tool_jacobian,
)
from cosim.arm.parameters import SET_NAMES, Mounting, ParameterSet, mounted, parameter_set, with_payload
from cosim.arm.segments import Segment, Segments, point_mass_pi, segment_pi
from cosim.arm.workspace import BOX, LINKED, Definiteness, Workspace, definiteness, singularity

__all__ = [
    "BOX",
    "LINKED",
    "SET_NAMES",
    "Attachment",
    "Counterweights",
    "Definiteness",
    "Dissection",
    "Motion",
    "Mounting",
    "ParameterSet",
    "Segment",
    "Segments",
    "Workspace",
    "angular_jacobian",
    "balancing_weights",
    "coriolis_matrix",
    "definiteness",
    "dissect",
    "fitted",
    "forward",
    "forward_dynamics",
    "friction_torque",
    "full_regressor",
    "gravity_torque",
    "heaviest_direction",
    "inverse",
    "inverse_behind",
    "inverse_dynamics",
    "jacobian",
    "jacobian_rate",
    "kinetic_energy",
    "mass_matrix",
    "mounted",
    "orientation",
    "parameter_set",
    "point_mass_pi",
    "potential_energy",
    "random_motion",
    "sampled_motion",
    "regressor",
    "segment_pi",
    "singularity",
    "tip_mass",
    "tool_jacobian",
    "total_energy",
    "with_payload",
]
