"""What one forward dynamics and one Runge-Kutta step of a seven-joint arm cost, beside pinocchio's `aba`.

    python -m tests.benchmarks.serial_arm [--robot xarm7] [--rounds 9]

Ends with 1 where a forward dynamics takes more than twice pinocchio's `aba` or a step more than five of ours.
Processor time, least of the rounds, which alternate. Ours is C compiled with an FMU's flags, on the table cut to the
arm's joints; pinocchio is called through its binding, whose share is shown by an `aba` of a model of one joint.
"""

import argparse
import ctypes
import sys
import time

import numpy as np

from tests.support.model_harness import compile_library
from tests.support.robots import PinocchioArm, compiled, put, reduced, states

CALLS = 5000
MOST_FORWARD, MOST_STEP = 2.0, 5.0  # of one `aba`, of one forward dynamics
TIMING = """
#include <time.h>
static double spent(void) { return (double)clock() / CLOCKS_PER_SEC; }
/* Seconds of one call: articulated bodies at 64 states in turn. */
double time_forward(Model *m, int calls, const double *q, const double *dq, const double *tau)
{
    const int n = serial_count(m);
    double ddq[SERIAL_MOST];
    const double begun = spent();
    for (int i = 0; i < calls; i++) {
        const int at = (i & 63) * n;
        SerialPose pose;
        serial_pose(n, m->kinds, serial_links(m), q + at, &pose);
        serial_forward(n, m->kinds, serial_links(m), &pose, m->link_armature, m->pull, dq + at, tau + at, ddq);
        m->ddq[0] += 1e-300 * ddq[0];
    }
    return (spent() - begun) / calls;
}
double time_step(Model *m, int calls)
{
    const double begun = spent();
    for (int i = 0; i < calls; i++) integrate(m, 0, 0, 1e-6);
    return (spent() - begun) / calls;
}
"""


def main() -> None:
    """Measure and print."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--robot", default="xarm7")
    words.add_argument("--rounds", type=int, default=9)
    options = words.parse_args()
    arm = reduced(options.robot)
    ours, theirs = our_calls(arm.model), pinocchio_calls(options.robot, arm)
    times = {name: [] for name in (*ours, *theirs)}
    for _ in range(options.rounds):
        for name, call in (ours | theirs).items():
            times[name].append(call())
    least = {name: 1e9 * min(values) for name, values in times.items()}
    for name, value in least.items():
        print(f"{name:42s} {value:8.0f} ns")
    forward, step, aba, _ = least.values()
    print(f"ours to pinocchio {forward / aba:.2f} (binding included); a step is {step / forward:.2f} forward dynamics")
    if forward > MOST_FORWARD * aba or step > MOST_STEP * forward:
        sys.exit(f"more than {MOST_FORWARD:g} times pinocchio or {MOST_STEP:g} forward dynamics a step")


def our_calls(model):
    plant = compiled(model, internal_steps=1.0).start()
    library = compile_library(plant.source + TIMING)
    for function in (library.time_forward, library.time_step):
        function.restype = ctypes.c_double
    rows = [
        np.ascontiguousarray(column) for column in zip(*((q, dq, tau) for q, dq, _, tau, _ in states(model, 64, 1)))
    ]
    points = [row.ctypes.data_as(ctypes.c_void_p) for row in rows]
    memory = plant.memory.ctypes.data_as(ctypes.c_void_p)
    put(plant, tau=1.0)
    return {
        "ours, articulated bodies (C)": lambda: library.time_forward(memory, CALLS, *points),
        "ours, one step of RK4, 12 rows of states": lambda: library.time_step(memory, CALLS),
    }


def pinocchio_calls(name: str, arm):
    import pinocchio as pin

    theirs = PinocchioArm.of(name, arm).model
    q, dq, _, tau, _ = states(arm.model, 1, 1)[0]
    at, data = PinocchioArm(theirs, "").pose(q), theirs.createData()
    one, rest = pin.Model(), np.zeros(1)
    joint = one.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "j")
    one.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    small = one.createData()
    return {
        "pinocchio aba, through its binding": lambda: timed(lambda: pin.aba(theirs, data, at, dq, tau)),
        "the same of one joint": lambda: timed(lambda: pin.aba(one, small, rest, rest, rest)),
    }


def timed(call) -> float:
    begun = time.process_time()
    for _ in range(CALLS):
        call()
    return (time.process_time() - begun) / CALLS


if __name__ == "__main__":
    main()
