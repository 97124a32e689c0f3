"""Ten constants decide: every number that is compared with something in the rooms of the decision stands in
`cosim/effects/constants.py`, or here with what it is.
"""

import ast
import inspect
from pathlib import Path

from cosim.effects import constants
from tests.support.paths import ROOT

PLAIN = {0, 1, 2, -1, 100}  # counts, signs, percent
KINDS = {
    "numerics": """
        gram.4 model.FELT compare.3 errors.3 screen.WITHIN screen.SMOOTHING screen.NEGLIGIBLE replicates.0.5
        naming.CLOSE search.WORTH search.REACH search.LEAST_GAIN checks.8 closure.1e-12 controller.3
        smoothing.1e-12
        refusal.1e-09 refusal.1e-30 actuator.1e-09 model.FEWEST_ROWS moving_arm.6 moving_arm.UPRIGHT surroundings.3
        surroundings.4 surroundings.0.9 surroundings.0.1 surroundings.LASTING
    """,
    "bounds of physical parameters": """
        actuator.LONGEST actuator.0.6 mounting.0.5 moving_arm.UNBALANCED position.0.2 position.0.001 position.FEWEST
        speed.ENDED speed.RISEN surroundings.0.2 surroundings.DAMPED surroundings.0.6
        transmission.ONE_SIDED transmission.0.1 transmission.1.3 scene.SLIDING
    """,
    "what a recording must hold to be read or refused": """
        motion.SAME_RATE rigid_body.0.01 setting.FEW_BLOCKS smoothing.NOISE_SHARE refusal.STATIC refusal.INERTIA
        refusal.EXACT refusal.SHORTEST refusal.FEWEST_BLOCKS refusal.MOST_CLIPPED refusal.200 refusal.MOVING
        floor.0.3 floor.SAME effects_file.FORMAT
    """,
    "controllers and replays": """
        controller.0.9 controller.CLOSE controller.PULSES controller.0.999 controller.0.001 controller.0.01 drive.STEPS
        replay.LATE replay.LEAST simulation.FIRST table.FIRST table.STRETCHES
    """,
    "warnings": "closure.0.3 closure.0.5 closure.1.01 fitted.FORMS",
}


def deciding() -> set[str]:
    return {name for name in vars(constants) if name.isupper()}


def compared(tree: ast.AST) -> set[str]:
    """Numbers and names of constants within comparisons."""
    parts = [part for node in ast.walk(tree) if isinstance(node, ast.Compare) for part in ast.walk(node)]
    numbers = {
        str(part.value)
        for part in parts
        if isinstance(part, ast.Constant) and type(part.value) in (int, float) and part.value not in PLAIN
    }
    return numbers | {part.id for part in parts if isinstance(part, ast.Name) and part.id.isupper()}


def modules() -> list[Path]:
    return [path for room in ("closure", "effects") for path in sorted((ROOT / "cosim" / room).rglob("*.py"))]


def test_every_number_that_decides_is_one_of_ten_or_told_here():
    known = {word for words in KINDS.values() for word in words.split()}
    found = set()
    for path in modules():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        taken = {
            alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module == "cosim.effects.constants"
            for alias in node.names
        }
        found |= {f"{path.stem}.{what}" for what in compared(tree) - taken}
    assert found == known


def test_ten_constants_each_with_its_meaning_source_and_what_doubling_does():
    assert len(deciding()) <= 10
    source = inspect.getsource(constants)
    for name in deciding():
        text = source.partition(f"\n{name} = ")[2].partition('"""')[2].partition('"""')[0]
        assert "Source:" in text and "Doubled:" in text, name


def test_every_constant_is_used_in_the_decision():
    text = "".join(path.read_text(encoding="utf-8") for path in modules() if path.stem != "constants")
    assert {name for name in deciding() if name in text} == deciding()
