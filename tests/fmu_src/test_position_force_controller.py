"""Position-force: the asymptotic conditions of its README against the exact loop, and a hard wall over a delay."""

import numpy as np
import pytest

from tests.support.teleoperator import SIDES, teleoperate, vector


def rightmost(share: float, d: float, b: float, mass_l: float, mass_r: float, wall: float, k: float = 50.0) -> float:
    """Greatest real part of the roots at zero delay, without hand, local damping b."""
    remote = [mass_r, b + d, k + wall]
    local = [mass_l, b, 0.0]
    loop = np.polyadd(np.polymul(remote, local), [share * wall * d, share * wall * k])
    return float(np.roots(loop).real.max())


@pytest.mark.parametrize(("share", "mass_l", "mass_r"), [(1.0, 0.05, 0.2), (3.0, 0.05, 0.05), (1.0, 0.02, 0.05)])
def test_a_stiff_wall_parts_the_modes(share, mass_l, mass_r):
    """At zero delay the fast mode is stable where share D m_r/m_l < B + D: 10 % inside and outside, wall of 1e8 N/m."""
    d = 2.0
    edge = share * d * mass_r / mass_l - d
    assert edge > 0.0
    assert (
        rightmost(share, d, 1.1 * edge, mass_l, mass_r, 1e8)
        < 0.0
        < rightmost(share, d, 0.9 * edge, mass_l, mass_r, 1e8)
    )


@pytest.mark.parametrize(("share", "rests"), [(1.0, False), (0.2, True)])
def test_a_hard_wall_over_a_delay_makes_the_arm_bounce(share, rests):
    """150 ms each way: the force comes back late; a fifth of it does not throw the hand back."""
    given = SIDES | {"controller_l.force_gain": share, "channel_*.delay_mean": 0.15}
    result = teleoperate("PositionForceController", given, 5.0)
    late = np.abs(vector(result, "arm_r.dq")[-1000:]).max()
    assert late < 1e-3 if rests else late > 0.02


def test_the_hand_feels_what_the_remote_tip_meets():
    result = teleoperate("PositionForceController", SIDES | {"channel_*.delay_mean": 0.01}, 4.0)
    hand, wall = (vector(result, name)[-1, 0] for name in ("operator.f", "arm_r.f_contact"))
    assert hand == pytest.approx(-wall, rel=1e-3) and hand > 0.1
