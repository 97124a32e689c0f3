"""`python -m tests.support.laboratory_c OUT --kind one --count 20 --seed 1` writes OUT/001, OUT/002, ..."""

import argparse
from pathlib import Path

from tests.support.laboratory_c import FORMS, generate


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.support.laboratory_c")
    parser.add_argument("out", type=Path)
    parser.add_argument("--kind", choices=["one", "complete", "pair", "outside"], default="one")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1, help="of the first recording; the next ones follow")
    parser.add_argument("--phenomenon", help=f"one of {', '.join(sorted(FORMS))}")
    parser.add_argument("--strength", type=float, help="RMS of the effect over the noise floor")
    parser.add_argument("--machine", choices=["lift", "pendulum", "scara", "boom", "arm"])
    given = parser.parse_args()
    for n in range(given.count):
        recording = generate(given.seed + n, given.kind, given.phenomenon, given.strength, machine=given.machine)
        recording.write(given.out / f"{n + 1:03d}")


if __name__ == "__main__":
    main()
