"""Recordings of real robots through close-loop; as a program, the table of the README:  python -m
tests.closure.real_data [FOLDER]

FOLDER holds the full sets (default: shared/data beside the checkout); the excerpts in tests/data are shorter.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from cosim.closure.closure import Closure, close_loop
from cosim.measured import read
from tests.support.paths import SHARED

LEFT = ("4_Maryland_L_2_20", "4_Maryland_L_2_23")
SAME = ("4_Maryland_L_2_41", "4_Maryland_L_2_43")
OTHERS = ("4_Maryland_R_5_20", "4_Maryland_R_5_23", "5_Maryland_L_2_20", "5_Maryland_L_2_23")


def emps(folder: Path) -> Closure:
    """The linear drive: one run fitted, the run with force pulses held out."""
    files = [folder / "emps" / f"emps_{name}.csv" for name in ("train", "test_pulses")]
    return close_loop(read(files[:1], files[1:], description=folder / "emps/emps.toml"))


def wrist(folder: Path, joint: int) -> Closure:
    """A joint of the Staubli TX40 beside a given rigid torque."""
    return close_loop(read([folder / f"staubli_tx40_j{joint}.csv"]))


def tool(folder: Path, *held: str) -> Closure:
    """Two runs of the left spindle of tool 4 fitted, others held out."""
    files = [[folder / f"Tool_{name}.csv" for name in group] for group in (LEFT, held)]
    return close_loop(read(*files, description=folder / "mis_tool_cable.toml"))


def pendulum(folder: Path, name: str) -> Closure:
    """A run of the pendulum whose torque column may be computed."""
    return close_loop(read([folder / f"{name}.csv"], description=folder / "dfki_pendulum_1dof.toml"))


def rows(folder: Path) -> Iterator[tuple[str, Closure]]:
    """The recordings of the table, by what they are called there."""
    yield "EMPS linear drive", emps(folder)
    for joint in (6, 5):
        yield f"Staubli TX40, joint {joint}", wrist(folder / "residual_ready", joint)
    yield "cable-driven tool, other runs of it", tool(folder / "mis_tool_cable", *SAME)
    for held in OTHERS:
        yield f"the same, held out {held.replace('_Maryland', '')}", tool(folder / "mis_tool_cable", held)
    yield "pendulum, torque computed from the state", pendulum(folder / "dfki_pendulum_1dof", "gravity_comp")


def simulated(found: Closure) -> Iterator[float]:
    """Free simulation before, after, both with the levels of the reported rows [rad or m]; 0 where there is none."""
    s = found.simulation
    for side in (None, None) if s is None else (s.before, s.after):
        yield 0.0 if side is None else side[0]
    for side in (None, None) if s is None else (s.levelled_before, s.levelled_after):
        yield 0.0 if side is None else side.rms


def main(folder: Path = SHARED) -> None:
    print(
        "| recording | torque error before | after | unfiltered replay before | after "
        "| free simulation before | after | with its own levels before | after | named |\n" + "|---" * 10 + "|"
    )
    for label, found in rows(folder):
        errors = ("", "") if found.error is None else (found.error.before[0], found.error.after[0])
        replays = ("", "") if found.replay is None else (found.replay.raw_before[0], found.replay.raw_after[0])
        cells = [f"{x:.3g}" if x else "" for x in (*errors, *replays, *simulated(found))]
        print(
            "|",
            " | ".join(
                (label, *cells, ", ".join(f.name for f in found.verdict.findings) or found.verdict.answer.value)
            ),
            "|",
            flush=True,
        )


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
