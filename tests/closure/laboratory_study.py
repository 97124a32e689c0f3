"""close-loop on recordings of a laboratory that knows nothing of it: what it names, against what was put in.

python -m tests.closure.laboratory_study a --kind one --count 40 --first 1000
"""

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from importlib import import_module
from itertools import product
from pathlib import Path

import cosim
from cosim.sweeps.shares import interval

LEAST = 0.75
"""Of the noise floor that an effect has to add before it counts as one that shows."""
SIGNALS = {"direction": "dq", "speed": "dq", "torque": "tau", "load": "tau", "acceleration": "ddq"}
"""What the answer calls that on which a laboratory says a phenomenon depends; other words are alike."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("laboratory", choices=["a", "b", "c"])
    parser.add_argument("--kind", choices=["one", "complete", "pair", "outside"], default="one")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    given = parser.parse_args()
    generate = import_module(f"tests.support.laboratory_{given.laboratory}").generate
    found = Counter[str]()
    for seed in range(given.first, given.first + given.count):
        with tempfile.TemporaryDirectory() as name:
            generate(seed, kind=given.kind).write(Path(name))
            truth = json.loads((Path(name) / "truth.json").read_text(encoding="utf-8"))
            answer = answered(Path(name) / "data.csv")
        words = judged(truth, answer, given.kind)
        found.update(words)
        print(seed, truth["phenomena"], f"{truth['shows']:.2f}", told(answer), words, file=sys.stderr, flush=True)
    counted = found["counted"]
    for word, count in found.items():
        if word != "counted":
            print(f"{word:<12} {count:4d} of {counted}  {bounds(count, counted)}")


def answered(recording: Path) -> dict:
    """closure.json; a refusal as an error of the input counts as refused."""
    try:
        return cosim.close_loop([recording], replay=False).to_dict()
    except cosim.InputError as error:
        return {"verdict": "refused", "effects": [], "why": str(error)}


def told(answer: dict) -> str:
    """The answer in one line."""
    effects = [f"{e['name']}{e['joints']}~{','.join(e['indistinguishable_from'])}" for e in answer["effects"]]
    return f"{answer['verdict']}: {' '.join(effects)}"


def judged(truth: dict, answer: dict, kind: str) -> list[str]:
    """How an answer counts; nothing where the effect does not show."""
    if kind != "complete" and truth["shows"] < LEAST:
        return []
    words = ["counted", answer["verdict"]]
    wanted = [name for name in truth["phenomena"] if not name.startswith("unknown")]
    alike = set(truth.get("alike", []))
    sets = [{e["name"], *e["indistinguishable_from"]} for e in answer["effects"]]
    sure = {e["name"] for e in answer["effects"] if not e["indistinguishable_from"]} - {"unknown"}
    if kind in ("one", "pair") and all(any({name, *alike} & s for s in sets) for name in wanted):
        words.append("right")
    elif (kind == "one" and family_is_right(truth, answer)) or (kind == "pair" and all_is_told(truth, answer)):
        words += ["right", "by family"]
    if kind == "outside" and (answer["verdict"] == "unexplained" or any("unknown" in s for s in sets)):
        words.append("right")
    return words + ["sure wrong"] * bool(sure - alike - set(wanted))


def family_is_right(truth: dict, answer: dict) -> bool:
    """Whether what is left without a name, or a law that may as well be a nameless function, is on a joint of the
    phenomenon and depends on its own signals, or is said not to be told from what does.
    """
    wanted = wanted_of(truth)
    return any(
        alone(found) == wanted
        for effect in answer["effects"]
        if set(effect["joints"]) & set(truth["joints"])
        and "unknown" in (effect["name"], *effect["indistinguishable_from"])
        for found in signals(effect)
    )


def all_is_told(truth: dict, answer: dict) -> bool:
    """Whether the effects on the joints of the phenomena depend, taken together, on the signals of all of them."""
    wanted = wanted_of(truth)
    mine = [signals(e) for e in answer["effects"] if set(e["joints"]) & set(truth["joints"])]
    return any(alone(set().union(*each)) == wanted for each in product(*mine))


def wanted_of(truth: dict) -> set[str]:
    """On what the phenomena of a laboratory depend; a twist of the gear on load and history."""
    words = truth["depends_on"]
    return alone({plain(w) for word in words for w in (("history", "torque") if word == "twist" else (word,))})


def signals(effect: dict) -> list[set[str]]:
    """What an effect of the answer depends on; of one without a name also what it is not told from."""
    own = effect["joints"]
    if effect["name"] == "unknown":
        return [{plain(s, own) for s in some} for some in (effect["signals"], *effect["or_signals"])]
    words = effect["family"].removeprefix("a torque that depends on ").replace("history of ", "history_").split(" and ")
    return [{"history"} if "drive delivers" in effect["family"] else {plain(word, own) for word in words}]


def alone(found: set[str]) -> set[str]:
    """With a history goes the direction."""
    return found - {"dq"} if "history" in found else found


def plain(word: str, own: Sequence[int] = ()) -> str:
    """A signal of the answer to a joint `own` ("q1", "history of q1", "q2", or "q_j4", "q_2", which are recorded
    columns), or a word of a laboratory ("direction", "q of the other joint"), by one name.
    """
    if "history" in word or "past" in word:
        return "history"
    name = word.removesuffix(" of the other joint").split("_")[0].rstrip("0123456789")
    number = word.removeprefix(name)
    other = "_" in word or "other" in word or (number.isdigit() and bool(own) and int(number) not in own)
    return f"other {SIGNALS.get(name, name)}" if other else SIGNALS.get(name, name)


def bounds(count: int, of: int) -> str:
    """The share with its two-sided 95 % interval."""
    low, high = interval(count, of, 0.95)
    return f"{100 * count / of:5.1f} % ({100 * low:.1f} to {100 * high:.1f})"


if __name__ == "__main__":
    main()
