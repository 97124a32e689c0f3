"""Whether two versions of the project compute the same bits, side by side.

    python -m tests.benchmarks.same_bits OLD/.venv/bin/cosim NEW/.venv/bin/cosim [--only TEXT]

Every shipped scenario (SHA-256 of the time and of every signal of result.h5), `close-loop` on five recordings (SHA-256
of all numbers of closure.json) and three sweeps (SHA-256 of the columns of sweep.h5). Both versions are called through
their command line, one after the other, on the same inputs. Exit code 1 where anything differs. About 15 minutes on two
cores.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import h5py
import numpy as np

from tests.support.paths import DATA, SHARED

SWEEPS = ("gain-ladder", "parameter-sets", "unit-readings")
TIMES = {"wall_time"}  # keys of closure.json that tell of the moment, not of the result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("old", type=Path, help="`cosim` of the version before")
    parser.add_argument("new", type=Path, help="`cosim` of the version after")
    parser.add_argument("--only", default="", help="what contains this text")
    parser.add_argument(
        "--store", type=Path, help="JSON file with the digests of OLD: written where it is missing, else read"
    )
    options = parser.parse_args()
    known = json.loads(options.store.read_text()) if options.store and options.store.is_file() else {}
    different = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what, digest in jobs(options.old, folder):
            if options.only not in what:
                continue
            before = known.get(what) or digest(options.old, folder / "old")
            known[what] = before
            if options.store:
                options.store.write_text(json.dumps(known, indent=1))
            after = digest(options.new, folder / "new")
            different += before != after
            print(f"{what:40s} {before[:16]} {after[:16]} {'same' if before == after else 'DIFFERENT'}", flush=True)
    print(f"{different} differences" if different else "all the same")
    return 1 if different else 0


def jobs(cosim: Path, folder: Path) -> Iterator[tuple[str, object]]:
    """What is compared: a name, and a function of (cosim, folder) that gives the digest."""
    for scenario in shipped(cosim):
        yield f"run {scenario}", lambda program, out, s=scenario: run_digest(program, s, out / f"run-{s}")
    motion = folder / "identification.h5"
    call(cosim, "run", "identification", "--no-report", "--out", str(folder / "identification"))
    (folder / "identification" / "result.h5").rename(motion)
    for name, files in recordings(motion).items():
        yield (
            f"close-loop {name}",
            lambda program, out, n=name, f=files: closure_digest(program, f, out / f"closure-{n}"),
        )
    for sweep in SWEEPS:
        yield f"sweep {sweep}", lambda program, out, s=sweep: sweep_digest(program, s, out / f"sweep-{s}")


def shipped(cosim: Path) -> list[str]:
    """Names of the shipped scenarios."""
    lines = call(cosim, "list").splitlines()
    words = [line.split()[0] for line in lines if line.strip()]
    return [word for word in words if word not in SWEEPS and (Path(word).suffix == "") and is_scenario(cosim, word)]


def is_scenario(cosim: Path, name: str) -> bool:
    return subprocess.run([cosim, "show", name], capture_output=True, check=False).returncode == 0


def recordings(motion: Path) -> dict[str, list[str]]:
    """Arguments of close-loop for five recordings: three of other people's robots, one of them split, and a simulated
    one.
    """
    cable = DATA / "mis_tool_cable"
    about = ["--description", str(cable / "mis_tool_cable.toml")]
    left = [str(cable / f"Tool_4_Maryland_L_2_{run}.csv") for run in ("20", "23", "41")]
    emps = SHARED / "emps"
    linear = [str(emps / f"emps_{run}.csv") for run in ("train", "test_pulses")]
    return {
        "emps": [linear[0], "--test", linear[1], "--description", str(emps / "emps.toml")],
        "staubli-j6": [str(DATA / "staubli_tx40" / "staubli_tx40_j6.csv")],
        "cable": [*left[:2], "--test", left[2], *about],
        "cable-one-run": [left[0], *about],
        "simulated": [str(motion)],
    }


def run_digest(cosim: Path, scenario: str, out: Path) -> str:
    call(cosim, "run", scenario, "--no-report", "--out", str(out))
    digest = sha256()
    with h5py.File(out / "result.h5") as file:
        digest.update(file["time"][...].tobytes())
        file["signals"].visititems(lambda name, item: feed(digest, name, item))
    return digest.hexdigest()


def sweep_digest(cosim: Path, sweep: str, out: Path) -> str:
    call(cosim, "sweep", sweep, "--no-report", "--workers", "2", "--out", str(out))
    digest = sha256()
    with h5py.File(out / "sweep.h5") as file:
        file["columns"].visititems(lambda name, item: name != "replay" and feed(digest, name, item))
    return digest.hexdigest()


def feed(digest, name: str, item) -> None:
    if isinstance(item, h5py.Dataset):
        values = item[...]
        digest.update(name.encode())
        digest.update(values.tobytes() if values.dtype.kind == "f" else repr(values.tolist()).encode())


def closure_digest(cosim: Path, files: list[str], out: Path) -> str:
    call(cosim, "close-loop", *files, "--out", str(out))
    found = json.loads((out / "closure.json").read_text())
    text = "\n".join(f"{where} {value!r}" for where, value in numbers(found, ""))
    return sha256(text.encode()).hexdigest()


def numbers(value: object, where: str) -> Iterator[tuple[str, float]]:
    """Every number of nested plain data with its place."""
    if isinstance(value, dict):
        for key, part in value.items():
            if key not in TIMES:
                yield from numbers(part, f"{where}.{key}")
    elif isinstance(value, list):
        for k, part in enumerate(value):
            yield from numbers(part, f"{where}[{k}]")
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield where, value if np.isfinite(value) else 0.0


def call(cosim: Path, *arguments: str) -> str:
    """What the command prints. Raises where it fails."""
    done = subprocess.run([cosim, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{cosim} {' '.join(arguments)}: exit code {done.returncode}\n{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
