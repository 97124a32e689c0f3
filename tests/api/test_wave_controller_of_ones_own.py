"""Wave variables written by hand into a new controller: built, wired, run, swept, analysed, beside the shipped one.

Niemeyer and Slotine (IEEE J. Oceanic Engineering 16, 1991): u = (b v + F) / sqrt(2b) comes in, (b v - F) / sqrt(2b)
goes out; v is the velocity of the port, and F = p + D (v - dx) what spring and damper between port and arm give,
p' = K (v - dx).
"""

import re
from pathlib import Path

import numpy as np
import pytest

import cosim

ROWS = """
[[include]]
file = "../shared/port.toml"

[[variable]]
name = "f"
size = 3
causality = "output"
unit = "N"
feedthrough = ["dx[i]", "wave_received[i]"]
description = "force on the tip"

[[variable]]
name = "tau"
size = 3
causality = "output"
unit = "N.m"
description = "none"

[[variable]]
name = "wave_received"
size = 3
names = ["received[1]", "received[2]", "received[3]"]
causality = "input"
unit = "N"
description = "sqrt(2b) u, incoming"

[[variable]]
name = "wave_sent"
size = 3
names = ["sent[1]", "sent[2]", "sent[3]"]
causality = "output"
unit = "N"
feedthrough = ["dx[i]", "wave_received[i]"]
description = "sqrt(2b) u, outgoing"

[[variable]]
name = "p"
size = 3
causality = "state"
unit = "N"
derivative = "der_p"
description = "force of the spring between port and arm"

[[variable]]
name = "der_p"
size = 3
causality = "local"
unit = "N/s"
feedthrough = ["dx[i]", "wave_received[i]"]
description = "its rate"

[[variable]]
name = "impedance"
causality = "parameter"
unit = "N.s/m"
start = 2.0
min = 1e-6
description = "b"

[[variable]]
name = "stiffness"
causality = "tunable"
unit = "N/m"
start = 50.0
description = "K"

[[variable]]
name = "derivative_gain"
causality = "tunable"
unit = "N.s/m"
start = 2.0
description = "D"
"""
LAW = """#include <math.h>

/* u = (b v + F) / sqrt(2b) with F = p + D (v - dx) gives v */
static inline double port_velocity(const MyWaveModel *m, int i) {
    const double u = m->wave_received[i] / sqrt(2.0 * m->impedance);
    const double known = sqrt(2.0 * m->impedance) * u - m->p[i] + m->derivative_gain * m->dx[i];
    return known / (m->impedance + m->derivative_gain);
}
"""
CODE = """#include "law.h"

static void derivatives(Model *m, double t) {
    (void)t;
    for (int i = 0; i < 3; i++) m->der_p[i] = m->stiffness * (port_velocity(m, i) - m->dx[i]);
}

static void outputs(Model *m, double t) {
    (void)t;
    for (int i = 0; i < 3; i++) {
        const double v = port_velocity(m, i), force = m->p[i] + m->derivative_gain * (v - m->dx[i]);
        m->f[i] = force;
        m->wave_sent[i] = m->impedance * v - force;
    }
}
"""
FREE = {"experiment.stop": 1.5, "arm_r.contact_stiffness": 0.0}


@pytest.fixture(scope="module")
def own(tmp_path_factory) -> Path:
    """What `cosim new controller` writes, with the law of wave variables in its place."""
    folder = cosim.new("controller", tmp_path_factory.mktemp("own") / "MyWave").path
    table = (folder / "model.toml").read_text()
    head = table.partition("[[variable]]")[0].replace('kind = "sampled"', 'kind = "continuous"')
    (folder / "model.toml").write_text(re.sub(r"# it acts.*", "", head) + ROWS)
    (folder / "law.h").write_text(LAW)
    (folder / "model.c").write_text(CODE)
    return folder


def with_model(model: str | Path, **values: object) -> cosim.Scenario:
    return cosim.load("controllers").with_values({"controller_*.model": str(model)} | FREE | values)


def test_it_is_the_shipped_one_to_rounding(own):
    shipped, mine = cosim.run(with_model("WaveController")), cosim.run(with_model(own))
    found = cosim.compare([shipped, mine], tolerance=1e-11, names=["shipped", "own"])
    assert found.agrees, str(found)
    (pair,) = found.found.pairs
    assert not pair.same and {"arm_r.x[1]", "controller_l.sent[1]", "channel_lr.y[1]"} <= {
        s.match.name for s in pair.signals
    }
    assert np.ptp(shipped["arm_r.x"][:, 0]) > 0.005  # the remote arm has moved
    worse = cosim.run(with_model(own, **{"controller_*.impedance": 2.001}))
    assert cosim.compare([shipped, worse], tolerance=1e-11).agrees is False


def test_it_is_stable_at_any_constant_delay(own):
    """The theorem of wave variables, by the exact spectrum of the linear loop; the controller was never seen before."""
    told = cosim.stability(with_model(own, **{"channel_*.delay_mean": 0.3})).to_dict()
    assert told["spectrum"]["abscissa"] < 0.0 and told["spectrum"]["unbounded"]
    assert told["simulation"]["growth_rate"] < 0.0 and "spectrum" not in told["withheld"]


SWEEP = """
format = 1
scenario = "controllers"
[set]
"controller_*.model" = "{own}"
"experiment.stop" = 0.5
"arm_r.contact_stiffness" = 0.0
[[axes]]
name = "delay"
unit = "s"
paths = ["channel_*.delay_mean"]
values = [0.01, 0.05]
[[axes]]
name = "impedance"
unit = "N.s/m"
paths = ["controller_*.impedance"]
values = [1.0, 2.0]
[grid]
"""


def test_a_sweep_of_it_is_that_of_the_shipped_one(own, tmp_path):
    spec = tmp_path / "waves.toml"
    spec.write_text(SWEEP.format(own=own))
    mine = cosim.sweep(spec, workers=2)
    shipped = cosim.sweep(spec, workers=2, set={"controller_*.model": "WaveController"})
    found = cosim.compare([shipped, mine], tolerance=0.0).to_dict()
    assert found["agrees"] and found["pairs"][0]["equal_points"] == 4 and found["pairs"][0]["flipped"] == 0
    np.testing.assert_allclose(mine.columns["growth_rate"], shipped.columns["growth_rate"], rtol=1e-4, atol=1e-6)
