"""python -m tests.support.laboratory_a OUT --kind one --count 20 --seed 1 [--phenomenon NAME ...] [--strength 2]"""

import argparse
from pathlib import Path

from tests.support.laboratory_a.generation import BOOK, KINDS, OUTSIDE, generate


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.support.laboratory_a", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--phenomenon", nargs="*", choices=[*BOOK, *OUTSIDE])
    parser.add_argument("--strength", type=float)
    given = parser.parse_args()
    for k in range(given.count):
        recording = generate(given.seed + k, given.phenomenon, given.strength, given.kind)
        folder = given.out / f"{given.kind or 'one'}-{given.seed + k:04d}"
        recording.write(folder)
        truth = recording.truth
        print(f"{folder}: {', '.join(truth['phenomena']) or 'complete'}, shows {truth['shows']:.2f}", flush=True)


main()
