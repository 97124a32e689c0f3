"""Counterweights on motors two and three: what they do to the parameters and how heavy they must be (Taati 4.2).

A weight on motor two sits at -L_cb along the upper arm, one on motor three at -L_cb along the forearm's direction.
Both are point masses: they change the inertial parameters too, which Taati Eqs. 16-17 leave out.
"""

import numpy as np
from attrs import evolve, frozen

from cosim.arm.kinematics import L1
from cosim.arm.parameters import ParameterSet
from cosim.arm.segments import point_mass_pi

LEVER = 0.070
"""L_cb [m] that gives the figures printed in Taati 4.2; the text itself says 0.075 (MISPRINTS.md)."""


@frozen
class Attachment:
    """A tool on the tip: mass [kg] and distance of its centre from the elbow along the forearm [m]."""

    mass: float = 0.09
    distance: float = 0.195


GIMBAL = Attachment()
"""The gimbal of Taati 4.2. His text measures L_ep from the distal end of the last link; 0.195 m is from the elbow."""


@frozen
class Counterweights:
    """Masses [kg] on motor two and motor three and their lever [m]; a negative mass belongs on the other side of the
    axis.
    """

    upper: float
    fore: float
    lever: float = LEVER


GCW_WEIGHT = Counterweights(upper=0.216, fore=0.0)
"""What the manufacturer supplies with the gimbal: one weight, on motor two (Taati 4.2)."""


def fitted(params: ParameterSet, tool: Attachment, weights: Counterweights) -> ParameterSet:
    """The arm with tool and counterweights, all eight parameters changed by physics; g7 and g8 are Taati Eqs. 16-17."""
    gravity = params.mounting.gravity
    pi = (
        params.pi
        + point_mass_pi(tool.mass, L1, tool.distance, gravity)
        + point_mass_pi(weights.upper, -weights.lever, 0.0, gravity)
        + point_mass_pi(weights.fore, 0.0, -weights.lever, gravity)
    )
    return evolve(params, name=f"{params.name} with tool and counterweights", pi=pi)


def balancing_weights(
    params: ParameterSet, tool: Attachment, lever: float = LEVER, upper_arm: float = L1
) -> Counterweights:
    """The masses that make g7 = g8 = 0 with the tool on, Taati Eqs. 18-19.

    `upper_arm` [m] is L1; the paper's text uses 0.216.
    """
    gravity = params.mounting.gravity
    g7, g8 = params.pi[6:]
    upper = (g7 + gravity * tool.mass * upper_arm) / (gravity * lever)
    fore = (g8 + gravity * tool.mass * tool.distance) / (gravity * lever)
    return Counterweights(float(upper), float(fore), lever)


def gravity_parameters(
    params: ParameterSet, tool: Attachment, weights: Counterweights, upper_arm: float = L1
) -> np.ndarray:
    """(g7', g8') [N m] of Taati Eqs. 16-17 with any `upper_arm` [m], to show what the printed lengths give."""
    gravity = params.mounting.gravity
    moments = tool.mass * np.array([upper_arm, tool.distance]) - weights.lever * np.array([weights.upper, weights.fore])
    return params.pi[6:] + gravity * moments


@frozen
class PrintedFigure:
    """One figure of Taati 4.2: as printed, with the printed lengths, with those that give it."""

    name: str
    unit: str
    printed: float
    decimals: int
    from_text: float
    put_right: float


TEXT_LEVER, TEXT_UPPER_ARM = 0.075, 0.216
"""L_cb and L1 [m] as the text of Taati 4.2 prints them."""


def printed_figures(params: ParameterSet) -> tuple[PrintedFigure, ...]:
    """The four figures of Taati 4.2 recomputed with the lengths of the text and with 0.070 and 0.215 m."""
    text_weight = evolve(GCW_WEIGHT, lever=TEXT_LEVER)
    text = [*gravity_parameters(params, GIMBAL, text_weight, TEXT_UPPER_ARM)]
    right = [*gravity_parameters(params, GIMBAL, GCW_WEIGHT)]
    for values, weights in (
        (text, balancing_weights(params, GIMBAL, TEXT_LEVER, TEXT_UPPER_ARM)),
        (right, balancing_weights(params, GIMBAL)),
    ):
        values += [weights.upper, weights.fore]
    names = (
        ("g7' with gimbal and its weight", "N m", 0.0223, 4),
        ("g8' with gimbal and its weight", "N m", 0.0622, 4),
        ("weight on motor two for balance", "kg", 0.248, 3),
        ("weight on motor three for balance", "kg", 0.091, 3),
    )
    return tuple(PrintedFigure(*name, float(t), float(r)) for name, t, r in zip(names, text, right, strict=True))
