"""Studies of the decision rule on blind rigs, printed as Markdown:  python -m tests.support.rig.study
nulls|detection|pairs|outside|viscosity

Every study simulates with tests/support/rig (own equations) and judges with `close_loop` as the command does. Nothing
in the tool is fitted to the seeds used here: the rule was set on seeds below 11000, the studies use seeds from 11000
on; only that a gap may stand behind an encoder's offset was added after a look at single effects on the latter.
"""

import argparse
import itertools
import time
from pathlib import Path

import numpy as np

from tests.support.rig.cases import EFFECTS, OUTSIDE, SIZES, complete, hidden, outside, true_parameters, two
from tests.support.rig.experiment import RigExperiment
from tests.support.rig.trial import TrialOutcome, run_all

PAIRS = (
    ("stribeck", "viscous_asymmetry"),
    ("actuator_lag", "stribeck"),
    ("hysteresis", "position_torque"),
    ("torque_ripple", "quadratic_drag"),
    ("load_friction", "torque_ripple"),
    ("position_friction", "joint_coupling"),
    ("friction_drift", "torque_ripple"),
    ("base_tilt", "stribeck"),
    ("torque_offset", "hysteresis"),
    ("joint_coupling", "actuator_lag"),
)


def experiment(seed):
    """Excitations of several bandwidths and amplitudes, three noise levels, two encoders."""
    fine = np.array((0.118e-3, 0.140e-3, 0.140e-3))
    return RigExperiment(
        seed=seed,
        highest=(5.0, 8.0, 5.0, 12.0)[seed % 4],
        tones=(10, 10, 6)[seed % 3],
        noise=(5e-4, 2e-4, 1e-3)[seed % 3],
        scale=(1.0, 0.7, 1.0)[(seed // 2) % 3],
        gravity=bool(seed % 2),
        resolution=fine * (1, 1, 2, 1, 0.25)[seed % 5],
        bandwidth=(40.0, 30.0, 55.0)[(seed // 3) % 3],
    )


def lower_bound(hits, count):
    """Clopper-Pearson lower 95 % bound."""
    from scipy.stats import beta

    return float(beta.ppf(0.05, hits, count - hits + 1)) if hits else 0.0


def upper_bound(hits, count):
    from scipy.stats import beta

    return float(beta.ppf(0.95, hits + 1, count - hits)) if hits < count else 1.0


def nulls(options):
    """False claims on complete models."""
    seeds = range(options.first, options.first + options.count)
    out = _run([(complete(s), experiment(s)) for s in seeds], options)
    good = [o for o in out if o.good]
    said = {v: sum(o.verdict == v for o in good) for v in ("effect_found", "unexplained", "refused")}
    print(
        f"**Complete models**: {len(good)}; {said['effect_found']} with a claim (upper 95 % bound "
        f"{100 * upper_bound(said['effect_found'], len(good)):.2f} %), "
        f"{said['unexplained']} `unexplained`, {said['refused']} refused."
    )
    for o in good:
        if o.verdict != "model_complete":
            print(f"- seed {o.seed}: {o.verdict} {o.found} {o.unknown[:2]}")
    return out


def _run(tasks, options):
    return run_all(tasks, options.duration, options.workers, options.out)


def detection(options):
    """Rate of the right name per effect and size; per visibility; parameters against their intervals; errors against
    the floor.
    """
    seeds = range(options.first, options.first + options.count)
    names = options.effects or list(EFFECTS)
    tasks = [(complete(s), experiment(s)) for s in seeds]
    tasks += [(hidden(n, a, s), experiment(s)) for a in options.sizes for n in names for s in seeds]
    out = _run(tasks, options)
    floors = {o.seed: o.before for o in out[: len(seeds)] if o.good}
    found = [o for o in out[len(seeds) :] if o.good and o.before and o.seed in floors]
    failed = [(o.label, o.seed, o.verdict) for o in out if o.verdict.startswith("error")]
    print(
        f"**One effect of the library**: {len(names)} effects, {len(found)} "
        f"runs; {len(failed)} ended in an error {failed or ''}\n"
    )
    doubted = sum(o.right and all("unknown" in f[2] for f in o.found) for o in found)
    print(f"Of the right names {doubted} of {sum(o.right for o in found)} stand beside `unknown`.\n")
    visibility(found, floors)
    precision(found, floors)
    table(found, names, options.sizes, floors)
    return out


def share(o, floors):
    """How far the effect shows: what it adds to the complete model's residual over that of the same rig without it,
    strongest joint.
    """
    joints = [j - 1 for joints in o.truth.values() for j in joints]
    return max(np.sqrt(max(o.before[j] ** 2 - floors[o.seed][j] ** 2, 0.0)) / floors[o.seed][j] for j in joints)


def visibility(found, floors):
    """Right names by how far the effect shows; the detection limit is where 95 % and more are right from there on."""
    edges = (0, 0.25, 0.5, 0.75, 1, 1.5, 2, 4, np.inf)
    shown = np.array([share(o, floors) for o in found])
    print("| adds to the residual, times the floor | runs | right | with a wrong name |\n|---|---|---|---|")
    for low, high, span in _spans(edges):
        group = [o for o, x in zip(found, shown, strict=True) if low <= x < high]
        if group:
            right, extra = 100 * np.mean([o.right for o in group]), sum(bool(o.extra) for o in group)
            print(f"| {span} | {len(group)} | {right:.0f} % | {extra} |")
    limit = next(
        (
            x
            for x in edges[:-1]
            if np.mean([o.right for o, y in zip(found, shown, strict=True) if y >= x] or [0]) >= 0.95
        ),
        None,
    )
    if limit is None:
        print("\nNo detection limit: less than 95 % are right however far the effects show.")
        return
    above = [o for o, x in zip(found, shown, strict=True) if x >= limit]
    right = sum(o.right for o in above)
    print(
        f"\nDetection limit (95 % right from there on): {limit:g} times the floor. Above it "
        f"{right} of {len(above)} are right, {100 * right / len(above):.1f} %, "
        f"lower 95 % bound **{100 * lower_bound(right, len(above)):.1f} %**; a "
        f"wrong name in {sum(bool(o.extra) for o in above)}."
    )
    missed = [o for o in above if not o.right or o.extra]
    print(
        "Missed or beside: "
        + "; ".join(
            f"{o.label} {o.size:g}, seed {o.seed}: {' '.join(f[0] for f in o.found) or o.verdict}" for o in missed
        )
    )


def _spans(edges):
    """Neighbouring edges, and the span between them in words."""
    return [
        (low, high, f"{low:g} to {high:g}" if high < np.inf else f"above {low:g}")
        for low, high in itertools.pairwise(edges)
    ]


def precision(found, floors):
    """Parameters of the runs with the right name alone: inside their intervals; held-out error after it over the
    floor.
    """
    inside, ratios = [], [ratio(o, floors) for o in found if o.right and not o.extra]
    for o in found:
        if o.right and not o.extra:
            values = {k: v for k, v in true_parameters(hidden(o.label, o.size, o.seed)).items() if k in o.interval}
            inside += [(o.label, o.interval[k][0] <= v <= o.interval[k][1]) for k, v in values.items()]
    if ratios:
        before, after = np.array(ratios).T
        outside = {n: sum(not x for m, x in inside if m == n) for n in sorted({m for m, x in inside if not x})}
        print(
            f"\nParameters inside their 95 % intervals: {sum(x for _, x in inside)} of "
            f"{len(inside)} (outside: {outside}). Held-out error over the floor, "
            f"worst joint of each run, median: {np.median(before):.2f} before, "
            f"**{np.median(after):.2f}** after; after within 1.2 in "
            f"{100 * np.mean(after <= 1.2):.0f} %.\n"
        )


def ratio(o, floors):
    """Held-out error before and after over the floor, the worst joint with the effect."""
    joints = [j - 1 for joints in o.truth.values() for j in joints]
    return tuple(max(e[j] / floors[o.seed][j] for j in joints) for e in (o.before, o.after))


def table(found, names, sizes, floors):
    """Per effect: right of all runs at each size, and by how far it shows (in floors), a detection curve; error after
    over the floor.
    """
    spans = _spans((0, 0.5, 1, 2, 4, np.inf))
    heads = (
        "effect",
        *(f"size {a:g}" for a in sizes),
        *(span for _, _, span in spans),
        "error after / floor",
        "wrong names",
    )
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for name in names:
        own = [o for o in found if o.label == name]
        cells = [
            f"{sum(o.right for o in group)}/{len(group)}" for a in sizes for group in [[o for o in own if o.size == a]]
        ]
        curve = [[o.right for o in own if low <= share(o, floors) < high] for low, high, _ in spans]
        after = [ratio(o, floors)[1] for o in own if o.right and not o.extra]
        extra = [f[0] for o in own for f in o.extra]
        cells += [
            *(f"{sum(hits)}/{len(hits)}" if hits else "" for hits in curve),
            f"{np.median(after):.2f}" if after else "-",
        ]
        print(f"| {' | '.join((name, *cells, _counted(extra)))} |")


def pairs(options):
    """Two effects at once."""
    seeds = range(options.first, options.first + options.count)
    tasks = [(two(a, b, options.size, s), experiment(s)) for a, b in PAIRS for s in seeds]
    out = _run(tasks, options)
    print("| pair | both | at least one | wrong names |\n|---|---|---|---|")
    for a, b in PAIRS:
        group = [o for o in out if o.label == f"{a}+{b}" and o.good]
        one = sum(any(o.hit(n, j) for n, j in o.truth.items()) for o in group)
        extra = [f[0] for o in group for f in o.extra]
        print(f"| {a} + {b} | {sum(o.right for o in group)}/{len(group)} | {one} | {_counted(extra)} |")
    good = [o for o in out if o.good]
    right = sum(o.right for o in good)
    print(
        f"\nBoth named: {right} of {len(good)}, {100 * right / len(good):.1f} %, lower "
        f"95 % bound **{100 * lower_bound(right, len(good)):.1f} %**."
    )
    return out


def beyond(options):
    """Effects that no library has: unexplained with the right signals, no wrong name."""
    seeds = range(options.first, options.first + options.count)
    tasks = [(complete(s), experiment(s)) for s in seeds]
    tasks += [(outside(n, options.size, s), experiment(s)) for n in OUTSIDE for s in seeds]
    out = _run(tasks, options)
    floors = {o.seed: o.before for o in out[: len(seeds)] if o.good and o.before}
    print(
        "| effect | `unexplained` | with the right signals | `model_complete` (at most, floors) | named "
        "beside `unknown` | named (runs, at most, floors) |\n|---|---|---|---|---|---|"
    )
    for name, (_, signals) in OUTSIDE.items():
        group = [o for o in out if o.label == name and o.good]
        doubted, named = (
            [f[0] for o in group for f in o.found if ("unknown" in f[2]) is doubt] for doubt in (True, False)
        )
        said = sum(o.verdict == "unexplained" for o in group)
        right = sum(
            o.verdict == "unexplained" and any(_fits(x, signals, o.truth["unknown"]) for x in o.unknown) for o in group
        )
        nothing = _at_most([o for o in group if o.verdict == "model_complete"], floors)
        sure = _at_most([o for o in group if any("unknown" not in f[2] for f in o.found)], floors)
        print(
            f"| {name} | {said}/{len(group)} | {right} | {nothing} | "
            f"{_counted(doubted)} | {_counted(named)}{sure and f' in {sure}'} |"
        )
    return out


def _at_most(group, floors):
    """How many, and the largest held-out error that one of them leaves on a joint with the effect, over the floor."""
    after = [max(o.after[j - 1] / floors[o.seed][j - 1] for j in o.truth["unknown"]) for o in group if o.seed in floors]
    return f"{len(group)} ({max(after):.1f})" if after else str(len(group) or "")


def _counted(names):
    return ", ".join(f"{n} {names.count(n)}" for n in sorted(set(names)))


def _fits(unknown, signals, joints):
    """Whether one joint's nameless dependence is on all signals of one of the sets, on a joint that has the effect."""
    joint, found = unknown
    found = {*found, *(s.rstrip("123") for s in found)}
    return joint in joints and any(wanted <= found for wanted in signals)


def viscosity(options):
    """PHYSICS section 1: negative viscosity from a Stribeck effect that the model lacks, and from chatter of the
    sign.
    """
    from dataclasses import replace

    from tests.support.rig.cases import COULOMB, Case, base
    from tests.support.rig.plant import SIGN

    seeds = range(options.first, options.first + options.count)
    cases = []
    for s in seeds:
        plant = replace(base(s), viscous=np.full(3, 0.5e-3))
        cases.append(
            Case(
                "stribeck plant",
                replace(plant, stribeck=0.4 * COULOMB, stribeck_velocity=np.full(3, 0.6)),
                {"stribeck": {1, 2, 3}},
            )
        )
        cases.append(Case("chatter plant", replace(plant, law=SIGN), {}))
    out = _run(list(zip(cases, [experiment(s) for s in seeds for _ in range(2)], strict=True)), options)
    for label in ("stribeck plant", "chatter plant"):
        group = [o for o in out if o.label == label and o.good]
        negative = np.mean([v < 0 for o in group for v in o.viscous])
        named = np.mean([any(f[0] == "stribeck" or "stribeck" in f[2] for f in o.found) for o in group])
        print(
            f"- {label}: {100 * negative:.0f} % of the complete model's viscous "
            f"coefficients are negative, stribeck is named in {100 * named:.0f} %"
        )
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=("nulls", "detection", "pairs", "outside", "viscosity"))
    parser.add_argument("--count", type=int, default=20, help="seeds a case (nulls: 1000)")
    parser.add_argument("--first", type=int, default=11000, help="first seed")
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--sizes", type=float, nargs="+", default=list(SIZES))
    parser.add_argument("--size", type=float, default=3.0)
    parser.add_argument("--effects", nargs="+")
    parser.add_argument(
        "--out",
        type=Path,
        help="JSON lines of all outcomes, kept as they come; a study that was stopped goes on from it",
    )
    options = parser.parse_args()
    start = time.time()
    study = {"nulls": nulls, "detection": detection, "pairs": pairs, "outside": beyond, "viscosity": viscosity}[
        options.study
    ]
    out: list[TrialOutcome] = study(options)
    print(f"{len(out)} runs in {time.time() - start:.0f} s")


if __name__ == "__main__":
    main()
