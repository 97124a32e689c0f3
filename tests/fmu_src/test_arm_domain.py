"""Runs of the arm end where its model ends: `domain_exit`, with a finite result up to there."""

import numpy as np
import pytest

from cosim.arm import dynamics
from cosim.arm.parameters import parameter_set
from cosim.arm.workspace import LINKED, definiteness
from cosim.engine.master import run
from cosim.engine.outcome import Outcome
from cosim.scenario import load_scenario

SCENARIO = """
format = 1
title = "An arm that is let go"
connections = ["hand.f -> arm.f"]
[experiment]
stop = 2.0
step = 1e-3
[components.hand]
model = "Operator"
parameters = {{ amplitude = 0.0 }}
[components.arm]
model = "PhantomArm"
parameter_set = "{name}"
[components.arm.parameters]
q_start = {q}
dq_start = {dq}
gravity_compensation = {compensated}
workspace_limits = {limits}
"""


def let_go(folder, name, q, dq, limits, compensated=True):
    """Result of the run of one arm that starts so and is left alone."""
    path = folder / "arm.toml"
    flags = {"limits": str(limits).lower(), "compensated": str(compensated).lower()}
    path.write_text(SCENARIO.format(name=name, q=list(map(float, q)), dq=list(map(float, dq)), **flags))
    return run(load_scenario(str(path)))


@pytest.mark.parametrize("name", ["UR", "GCW", "FS", "USD", "USD+GCW"])
def test_identified_arm_leaves_its_domain(tmp_path, name):
    """Thrown towards the pose of the least M11, every identified set ends as domain_exit, with M > 0 up to there."""
    pi = parameter_set(name).pi
    centre, least = np.array([0.0, 0.35, 0.45]), np.array([0.0, *definiteness(pi).pose])
    way = centre + np.linspace(0, 1, 2001)[:, None] * (least - centre)
    start = way[np.flatnonzero(dynamics.yaw_inertia(pi, way) > 0.2e-3)[-1]]
    result = let_go(tmp_path, name, start, 5 * (least - centre) / np.linalg.norm(least - centre), limits=False)
    assert result.outcome is Outcome.DOMAIN_EXIT
    assert result.stopped_at < 1.0
    q = result.vector("arm.q")
    assert np.isfinite(q).all()
    assert np.linalg.eigvalsh(dynamics.mass_matrix(pi, q[:-1])).min() > 0


def test_workspace_limits_end_a_run(tmp_path):
    """The segment set has M > 0 everywhere: only box and linkage end its run, and where numpy has them."""
    start, push = (0.0, 0.3, 0.4), (0.0, 1.5, 0.0)
    result = let_go(tmp_path, "segment", start, push, limits=True)
    assert result.outcome is Outcome.DOMAIN_EXIT
    q = result.vector("arm.q")
    inside = LINKED.contains(q)
    assert inside[:-1].all()
    assert LINKED.contains(q[-1] - 0.02 * np.array(push)) or not inside[-1]
    free = let_go(tmp_path, "segment", start, push, limits=False)
    assert free.outcome is not Outcome.DOMAIN_EXIT
    assert not LINKED.contains(free.vector("arm.q")).all()
