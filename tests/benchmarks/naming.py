"""Which effects two versions of `close-loop` name on the same recordings, as one table.

    python -m tests.benchmarks.naming TREE [OLDER_TREE ...] [--first 31000] [--count 2] [--keep FOLDER] [--only CELL]

TREE is a checkout of the project; each version judges with its own `tests.support.rig.trial.judge`, in a process of its
own with PYTHONPATH=TREE. Runs of 30 s at 1 kHz of the rig: complete models, one effect of the library (size 2), pairs
(size 3), effects outside the library (size 3); `--count` runs a case. Bounds are one-sided 95 % (Clopper, Pearson
1934).

A name is *sure* where nothing stands in `indistinguishable_from`. An effect shows where it adds at least 0.75 times the
residual of the same rig without it (held-out moving rows, complete model of the first tree).
"""

import argparse
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.support.rig.cases import EFFECTS, OUTSIDE, Case, complete, hidden, outside, two
from tests.support.rig.experiment import record
from tests.support.rig.study import PAIRS, experiment, lower_bound, share, upper_bound
from tests.support.rig.trial import TrialOutcome

SHOWS = 0.75  # floors
CELLS = ("complete", "one", "pairs", "outside")
JUDGE = """
import json, pickle, sys, time
from pathlib import Path
from tests.support.rig.trial import judge
tasks = pickle.loads(Path(sys.argv[1]).read_bytes())
with open(sys.argv[2], "a") as out:
    for k in map(int, sys.argv[3].split(",")):
        start = time.process_time()
        found = judge(tasks[k])
        out.write(json.dumps(found | {"number": k, "cpu": time.process_time() - start}) + "\\n")
        out.flush()
"""


def cases(cell: str, first: int, count: int) -> list[Case]:
    """Cases of a cell, `count` seeds a case (complete models: twenty times as many)."""
    seeds = range(first, first + count)
    if cell == "complete":
        return [complete(s) for s in range(first, first + 20 * count)]
    if cell == "pairs":
        return [two(a, b, 3.0, s) for a, b in PAIRS for s in seeds]
    names, make, size = (EFFECTS, hidden, 2.0) if cell == "one" else (OUTSIDE, outside, 3.0)
    return [make(name, size, s) for name in names for s in seeds]


def seeds_of(cell: str, first: int, count: int) -> list[int]:
    kinds = {"complete": 1, "pairs": len(PAIRS), "one": len(EFFECTS), "outside": len(OUTSIDE)}[cell]
    return [s for _ in range(kinds) for s in range(first, first + (20 * count if cell == "complete" else count))]


def simulated(cell: str, first: int, count: int, keep: Path) -> Path:
    """A file with the tasks of a cell: (run, case, experiment)."""
    path = keep / f"{cell}-{first}-{count}.pickle"
    if not path.is_file():
        made, settings = cases(cell, first, count), [experiment(s) for s in seeds_of(cell, first, count)]
        runs = record([case.plant for case in made], settings, 30.0)
        path.write_bytes(pickle.dumps(list(zip(runs, made, settings, strict=True))))
    return path


def judged(tree: Path, tasks: Path, count: int, out: Path) -> dict[int, tuple[TrialOutcome, float]]:
    """Outcomes and processor times by number; those that `out` holds are not judged again."""
    done = read(out)
    left = [k for k in range(count) if k not in done]
    if left:
        environment = os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
        words = [sys.executable, "-c", JUDGE, str(tasks), str(out), ",".join(map(str, left))]
        subprocess.run(words, cwd=tree, env=environment, check=True)
    return read(out)


def read(out: Path) -> dict[int, tuple[TrialOutcome, float]]:
    found = {}
    for line in out.read_text().splitlines() if out.is_file() else ():
        values = json.loads(line)
        known = {k: v for k, v in values.items() if k in TrialOutcome.__dataclass_fields__}
        found[values["number"]] = TrialOutcome(**known), values["cpu"]
    return found


def is_sure(found: list) -> bool:
    return not found[2]


def wrong(o: TrialOutcome) -> list:
    """Sure names that are not among the hidden effects on their joints."""
    return [f[0] for f in o.found if is_sure(f) and not (f[0] in o.truth and set(f[1]) & set(o.truth[f[0]]))]


def bounded(hits: int, count: int, upper: bool = False) -> str:
    """Hits of a count with their share and its bound."""
    if not count:
        return "-"
    bound = upper_bound(hits, count) if upper else lower_bound(hits, count)
    return f"{hits}/{count} ({'<' if upper else '>'} {100 * bound:.1f} %)"


def row(cell: str, outcomes: list[TrialOutcome], floors: dict[int, list]) -> list[str]:
    """Runs, right, complete, unexplained, sure wrong names."""
    good = [o for o in outcomes if o.good]
    if cell == "one":
        good = [o for o in good if o.before and o.seed in floors and share(o, floors) >= SHOWS]
    if cell == "complete":
        right = [o for o in good if o.verdict == "model_complete"]
    elif cell == "outside":
        right = [o for o in good if o.verdict == "unexplained" or any("unknown" in f[2] for f in o.found)]
    else:
        right = [o for o in good if o.right]
    sure = sum(bool(wrong(o)) for o in good)
    said = [sum(o.verdict == v for o in good) for v in ("model_complete", "unexplained")]
    return [bounded(len(right), len(good)), *map(str, said), bounded(sure, len(good), upper=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trees", type=Path, nargs="+")
    parser.add_argument("--first", type=int, default=31000, help="first seed")
    parser.add_argument("--count", type=int, default=2, help="runs a case; complete models: twenty times as many")
    parser.add_argument("--keep", type=Path, default=Path("results/naming"), help="recordings and outcomes")
    parser.add_argument("--only", nargs="+", choices=CELLS, default=CELLS)
    parser.add_argument("--misses", action="store_true", help="list the runs that are not right")
    options = parser.parse_args()
    options.keep = options.keep.resolve()
    options.keep.mkdir(parents=True, exist_ok=True)
    print("| cell | tree | right | model_complete | unexplained | sure wrong names | s a run |\n" + "|---" * 7 + "|")
    for cell in options.only:
        tasks = simulated(cell, options.first, options.count, options.keep)
        count = len(cases(cell, options.first, options.count))
        floors: dict[int, list] = {}
        misses = []
        for tree in options.trees:
            mark = tree.resolve().name
            found = judged(
                tree.resolve(), tasks, count, options.keep / f"{cell}-{options.first}-{options.count}-{mark}.jsonl"
            )
            if cell == "one" and not floors:
                floors = floor_errors(options, tree)
            outcomes = [found[k][0] for k in range(count)]
            seconds = np.mean([found[k][1] for k in range(count)])
            print(f"| {cell} | {mark} | {' | '.join(row(cell, outcomes, floors))} | {seconds:.1f} |", flush=True)
            misses += [
                (mark, o) for o in outcomes if o.good and (not o.right or wrong(o) or cell in ("complete", "outside"))
            ]
        for mark, o in misses if options.misses else ():
            print(
                mark,
                o.label,
                o.seed,
                o.truth,
                o.verdict,
                o.found,
                o.unknown[:2],
                [f"{x:.2g}" for x in o.before],
                [f"{x:.2g}" for x in o.after],
                o.withdrawn[:3],
            )


def floor_errors(options: argparse.Namespace, tree: Path) -> dict[int, list]:
    """Errors of complete models of the same seeds, by seed."""
    tasks = simulated("complete", options.first, options.count, options.keep)
    file = options.keep / f"complete-{options.first}-{options.count}-{tree.resolve().name}.jsonl"
    found = judged(tree.resolve(), tasks, options.count, file)
    return {o.seed: o.before for o, _ in found.values() if o.good and o.before}


if __name__ == "__main__":
    main()
