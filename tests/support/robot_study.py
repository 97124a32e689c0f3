"""The loop closed on a seven-joint rig: false claims on complete models, right names on the right joints.

    python -m tests.support.robot_study nulls --count 200 --out nulls.jsonl
    python -m tests.support.robot_study detection --count 7 --out detection.jsonl
    python -m tests.support.robot_study outside --count 7 --out outside.jsonl

Recordings of 40 s at 100 Hz of the public Panda by pinocchio with the joints of `tests.support.robot_joints`, the
second half held out. About 10 s of processor time a complete model, more an effect; a study that was stopped goes on
from its `--out`. Seeds from 5000 on.
"""

import argparse
import json
import os
import time
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np

from cosim.arm.robot import read_robot
from cosim.closure.closure import Options, close_loop
from cosim.measured import Recording, RecordingDescription, RobotDevice, Run
from tests.support.rig.study import lower_bound, upper_bound, visibility
from tests.support.rig.trial import TrialOutcome, answered
from tests.support.robot_joints import EFFECTS, OUTSIDE, RigJoints, complete, hidden
from tests.support.robot_rig import RobotRig
from tests.support.robots import robot_file

DURATION, RATE = 40.0, 100.0


@cache
def rig() -> RobotRig:
    """The rig, its URDF read once."""
    return RobotRig.panda()


@cache
def device() -> RobotDevice:
    """The device of the rig's recordings."""
    return RobotDevice(read_robot(robot_file("panda"), None, None))


def recorded(seed: int, joints: RigJoints, duration: float = DURATION) -> Recording:
    """The recording of a seed, the second half held out."""
    columns = rig().record(seed, duration, RATE, joints)
    q, tau = (np.stack([columns[f"{role}{j + 1}"] for j in range(7)], axis=1) for role in ("q", "tau"))
    n = len(q)
    return Recording(RecordingDescription(device()), (Run("rig", columns["time"], q, tau, np.arange(n) >= n // 2),))


def trial(label: str, size: float, seed: int) -> TrialOutcome:
    """One run: "complete", or an effect of `robot_joints`, through the tool."""
    joints, truth = (complete(seed), {}) if label == "complete" else hidden(label, size, seed)
    out = TrialOutcome(label, size, seed, {name: sorted(on) for name, on in truth.items()}, "")
    return answered(out, lambda: close_loop(recorded(seed, joints), Options(replayed=False)))


def _run(tasks: list[tuple[str, float, int]], out: Path | None) -> list[TrialOutcome]:
    lines = out.read_text(encoding="utf-8").splitlines() if out and out.exists() else []
    done = {(o.label, o.size, o.seed): o for o in (TrialOutcome(**json.loads(line)) for line in lines)}
    for number, task in enumerate(tasks, 1):
        if task not in done:
            done[task] = trial(*task)
            if out:
                with out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(done[task])) + "\n")
            found = [(name, joints) for name, joints, _ in done[task].found]
            print(f"  {number} of {len(tasks)}: {task[0]} {task[2]}: {done[task].verdict} {found}", flush=True)
    return [done[task] for task in tasks]


def nulls(seeds: range, options: argparse.Namespace) -> None:
    """False claims on complete models."""
    out = _run([("complete", 0.0, seed) for seed in seeds], options.out)
    claims = [o for o in out if o.found]
    others = [o for o in out if not o.found and o.verdict != "model_complete"]
    bound = 100 * upper_bound(len(claims), len(out))
    print(f"complete models: {len(out)}; with a claim {len(claims)} (upper 95 % bound {bound:.2f} %)")
    print(f"without a claim but not `model_complete`: {[(o.seed, o.verdict) for o in others]}")
    print(f"claims: {[(o.seed, o.found) for o in claims]}")


def detection(seeds: range, options: argparse.Namespace) -> None:
    """Right names, by how far an effect shows."""
    names = options.effects or list(EFFECTS)
    out = _run(
        [("complete", 0.0, s) for s in seeds] + [(n, options.size, s) for n in names for s in seeds], options.out
    )
    floors = {o.seed: o.before for o in out[: len(seeds)]}
    found = [o for o in out[len(seeds) :] if o.before]
    for name in names:
        own = [o for o in found if o.label == name]
        others = sorted(f[0] for o in own for f in o.extra)
        print(f"{name:20s} right {sum(o.right for o in own)} of {len(own)}; wrong names: {', '.join(others) or '-'}")
    right = sum(o.right for o in found)
    print(f"right {right} of {len(found)} (lower 95 % bound {100 * lower_bound(right, len(found)):.1f} %)")
    visibility(found, floors)


def outside(seeds: range, options: argparse.Namespace) -> None:
    """Effects that no library has: they may not be named for sure."""
    names = options.effects or list(OUTSIDE)
    for o in _run([(n, options.size, s) for n in names for s in seeds], options.out):
        sure = [f[0] for f in o.found if not f[2]]
        print(
            f"{o.label:14s} seed {o.seed}: {o.verdict}; sure names {sure or '-'}; left {o.unknown[:2]}; truth {o.truth}"
        )


def main() -> None:
    """Read the words, run, print."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("study", choices=("nulls", "detection", "outside"))
    words.add_argument("--count", type=int, default=7, help="seeds a case")
    words.add_argument("--first", type=int, default=5000)
    words.add_argument("--size", type=float, default=2.0)
    words.add_argument("--effects", nargs="+")
    words.add_argument("--out", type=Path, help="JSON lines of all outcomes")
    options = words.parse_args()
    began = time.process_time()
    seeds = range(options.first, options.first + options.count)
    {"nulls": nulls, "detection": detection, "outside": outside}[options.study](seeds, options)
    print(f"{time.process_time() - began:.0f} s of processor time")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
