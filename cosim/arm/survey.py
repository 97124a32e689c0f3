"""What a serial arm is like over its poses: where the tip gets, how heavy the joints are, what gravity asks of the
motors.
"""

import numpy as np
from attrs import frozen

from cosim.arm.serial import SerialModel
from cosim.arm.serial_dynamics import gravity_torque, mass_matrix
from cosim.arm.serial_kinematics import tip_jacobian, tip_position

POSES = 4000
"""Random poses of a survey: enough that the ranges change by a few per cent only with the seed."""


@frozen(eq=False)
class ArmSurvey:
    """Over `poses` random poses inside the limits: tips (poses, 3) [m]; dexterity (poses,), smallest over largest
    singular value of J; lightest and heaviest (n,) diagonal of M [kg m^2]; unevenness (2,), least and greatest
    condition number of M with its diagonal scaled to ones; gravity (n,) [N m], largest torque that holds the arm.
    """

    tips: np.ndarray
    dexterity: np.ndarray
    lightest: np.ndarray
    heaviest: np.ndarray
    unevenness: tuple[float, float]
    gravity: np.ndarray

    @property
    def poses(self) -> int:
        return len(self.tips)


def survey(model: SerialModel, poses: int = POSES, seed: int = 1) -> ArmSurvey:
    """Look at an arm in random poses; where a joint has no limits, in a whole turn (a slide: within 1 m)."""
    q = model.poses(poses, seed)
    mass = mass_matrix(model, q)
    diagonal = np.diagonal(mass, axis1=-2, axis2=-1)
    scale = 1 / np.sqrt(diagonal)
    eigenvalues = np.linalg.eigvalsh(scale[:, :, None] * mass * scale[:, None, :])
    condition = eigenvalues[:, -1] / eigenvalues[:, 0]
    singular = np.linalg.svd(tip_jacobian(model, q), compute_uv=False)
    dexterity = singular[:, -1] / np.maximum(singular[:, 0], 1e-300)
    return ArmSurvey(
        tips=tip_position(model, q),
        dexterity=dexterity,
        lightest=diagonal.min(axis=0),
        heaviest=diagonal.max(axis=0),
        unevenness=(float(condition.min()), float(condition.max())),
        gravity=np.abs(gravity_torque(model, q)).max(axis=0),
    )
