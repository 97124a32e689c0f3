"""The tests themselves: each checks something at every run, can fail, waits for no clock and says what it needs."""

import ast
from pathlib import Path

import pytest

from tests.support.assertions import SourceFile, source_file
from tests.support.needs import NEEDS, Need, expected, require
from tests.support.paths import ROOT

FILES = sorted((ROOT / "tests").rglob("*.py"))
TREES = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}


def place(path: Path, node: ast.AST) -> str:
    return f"{path.relative_to(ROOT)}:{node.lineno}"


def called(tree: ast.AST) -> list[tuple[str, ast.Call]]:
    """Calls and their names: `skip` for pytest.skip(...)."""
    found = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [(getattr(call.func, "attr", getattr(call.func, "id", "")), call) for call in found]


def test_every_test_checks_something_at_every_run():
    """Where this fails: say before the loop how many entries there are (`assert len(rows) == 3`)."""
    tests = [(path, test) for path in FILES if path.name.startswith("test_") for test in source_file(path).tests]
    assert len(tests) > 600
    assert not [f"{place(path, test.function)} {test.function.name}" for path, test in tests if not test.checks()]


CHECKING = [
    "for n in range(3): assert n < 3",
    "for n in (*(), 1): assert n",
    "words = 'a b'.split()\n for word in words: assert word",
    "for a, b in zip([1], f(), strict=True): assert a == b",
    "rows = f()\n assert len(rows) == 3\n for row in rows: assert row",
    "for row in three(): assert row",
    "for n in counted(): assert n",
    "for key, value in {'a': 1}.items(): helper(value)",
    "spread(f(), 'a')",
    "with pytest.raises(ValueError): f()",
    "subprocess.run(['true'], check=True)",
    "if f(): assert g()\n else: assert h()",
    "for n in NUMBERS[:2]: np.testing.assert_allclose(n, 1)",
    "assert all(n > 0 for n in NUMBERS)",
    "assert not [n for n in NUMBERS if n < 0]",
]
IDLE = [
    "f()",
    "for row in f(): assert row",
    "for a, b in zip([1], f()): assert a == b",
    "for a, b in zip(*f(), strict=True): assert a == b",
    "for n in [n for n in NUMBERS if n > 1]: assert n",
    "for n in NUMBERS[9:]: assert n",
    "while f(): assert g()",
    "if f(): assert g()",
    "rows = [1]\n rows = f()\n for row in rows: assert row",
    "assert all(row > 0 for row in f())",
    "assert not any(row < 0 for row in f())",
    "rows = [row for row in f() if row < 0]\n assert not rows",
    "spread(f())",
    "for row in f(): helper(row)",
    "def inner(): assert True\n f(inner)",
]
HELPERS = """
NUMBERS = [1, 2, 3]
def helper(value): assert value
def spread(text, *words):
 for word in words: assert word in text
def three(): return [1, 2, 3]
def counted():
 for n in range(2): yield n
def test_it():
 """


@pytest.mark.parametrize("body", CHECKING)
def test_a_check_that_is_reached_is_seen(body):
    assert [test.checks() for test in SourceFile(ast.parse(HELPERS + body)).tests] == [True]


@pytest.mark.parametrize("body", IDLE)
def test_a_check_that_may_not_be_reached_is_none(body):
    assert [test.checks() for test in SourceFile(ast.parse(HELPERS + body)).tests] == [False]


def cannot_fail(test: ast.expr) -> bool:
    """`True`, `x or True`, `x == x`, `len(x) >= 0`."""
    match test:
        case ast.Constant(value=value):
            return bool(value)
        case ast.BoolOp(op=ast.Or(), values=values):
            return any(map(cannot_fail, values))
        case ast.BoolOp(op=ast.And(), values=values):
            return all(map(cannot_fail, values))
        case ast.Compare(left=ast.Call(func=ast.Name(id="len")), ops=[ast.GtE()], comparators=[ast.Constant(value=0)]):
            return True
        case ast.Compare(left=left, ops=[ast.Eq() | ast.Is() | ast.LtE() | ast.GtE()], comparators=[right]):
            calls = any(isinstance(node, ast.Call) for node in ast.walk(left))  # called twice, it may differ
            return not calls and ast.dump(left) == ast.dump(right)
    return False


def test_every_assertion_can_fail():
    asserts = [(path, node) for path in FILES for node in ast.walk(TREES[path]) if isinstance(node, ast.Assert)]
    assert len(asserts) > 1000
    assert not [place(path, node) for path, node in asserts if cannot_fail(node.test)]


@pytest.mark.parametrize("text", ["True", "f() or True", "x == x", "len(x) >= 0", "1 and 'text'"])
def test_an_assertion_that_cannot_fail_is_seen(text):
    assert cannot_fail(ast.parse(text, mode="eval").body)


@pytest.mark.parametrize("text", ["x", "f() == f()", "x == y", "len(x) > 0", "x or y"])
def test_an_assertion_that_can_fail_is_left_alone(text):
    assert not cannot_fail(ast.parse(text, mode="eval").body)


def test_nothing_waits_a_fixed_time():
    """A test waits for what it waits for; `sleep` stands in the loop that looks for it."""
    found = [(path, call) for path in FILES for name, call in called(TREES[path]) if name == "sleep"]
    looking = {
        id(call)
        for path in FILES
        for loop in ast.walk(TREES[path])
        if isinstance(loop, ast.While)
        for _, call in called(loop)
    }
    assert found
    assert not [
        place(path, call) for path, call in found if isinstance(call.args[0], ast.Constant) and id(call) not in looking
    ]


def test_what_a_test_needs_is_named_in_the_table():
    """`@pytest.mark.needs("wine")` or `require("data")` of tests/support/needs.py; no other way to skip."""
    others = {"skip", "skipif", "importorskip", "xfail"}
    skips = [(path, call) for path in FILES for name, call in called(TREES[path]) if name in others]
    assert [path.name for path, _ in skips].count("needs.py") == 1
    assert not [place(path, call) for path, call in skips if path.name != "needs.py"]


def test_what_is_absent_skips_and_fails_where_it_is_declared(monkeypatch):
    monkeypatch.setitem(NEEDS, "wine", Need("Wine", lambda: False))
    monkeypatch.delenv("COSIM_EXPECTS", raising=False)
    with pytest.raises(pytest.skip.Exception, match="needs wine: Wine"):
        require("wine")
    monkeypatch.setenv("COSIM_EXPECTS", "data wine")
    with pytest.raises(pytest.fail.Exception, match="needs wine: Wine; COSIM_EXPECTS says that it is here"):
        require("wine")


def test_an_unknown_name_among_the_declared_is_refused(monkeypatch):
    monkeypatch.setenv("COSIM_EXPECTS", "data wien")
    with pytest.raises(pytest.UsageError, match="expected names out of data, .*; got wien"):
        expected()
