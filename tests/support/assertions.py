"""Whether a test checks something at every run, read from its source.

A check is an `assert`, `pytest.raises`, `np.testing`, a process that must succeed (`check=True`), or a call of a
function of the tests that checks. It counts where it is reached: not in a loop over something that may be empty; and
`all(...)` or `not any(...)` over something that may be empty is no check either. What holds an entry must be seen:
literals, ranges, constants of a module, and what is made of them.
"""

import ast
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path

from tests.support.paths import ROOT

PASSED_ON = set("enumerate sorted reversed list tuple set dict iter frozenset array".split())
"""Calls that give an entry where their first argument holds one."""
METHODS = {"items", "keys", "values", "copy", "tolist", "split", "splitlines"}
"""Methods that give an entry where their object holds one."""
GRIDS = {"linspace", "logspace", "geomspace"}
COMPREHENSIONS = ast.ListComp | ast.SetComp | ast.GeneratorExp | ast.DictComp


class SourceFile:
    """A file of the tests: its functions, its constants and what it imports."""

    def __init__(self, tree: ast.Module) -> None:
        self.functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        self.constants = assigned(tree.body)
        self.imported = {
            alias.asname or alias.name: (node.module or "", alias.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }

    @property
    def tests(self) -> list["AssertionReading"]:
        return [AssertionReading(self, node) for name, node in self.functions.items() if name.startswith("test_")]

    def function(self, name: str) -> "tuple[SourceFile, ast.FunctionDef] | None":
        """The function of the tests that has this name here, and its home."""
        if name in self.functions:
            return self, self.functions[name]
        home, original = self.imported.get(name, ("", ""))
        if not home.startswith("tests."):
            return None
        place = ROOT / home.replace(".", "/")
        there = source_file(place / "__init__.py" if place.is_dir() else place.with_suffix(".py"))
        return (there, there.functions[original]) if original in there.functions else None


@cache
def source_file(path: Path) -> SourceFile:
    return SourceFile(ast.parse(path.read_text(encoding="utf-8")))


class AssertionReading:
    """Reads one function: whether it checks, and what is seen to hold an entry in it."""

    def __init__(self, file: SourceFile, function: ast.FunctionDef, seen: frozenset[str] = frozenset()) -> None:
        self.file, self.function, self.seen = file, function, seen | {function.name}
        self.constants = file.constants | assigned(function.body)
        self.inner = {node.name: node for node in ast.walk(function) if isinstance(node, ast.FunctionDef)}
        self.parameters = parametrized(function)

    def checks(self) -> bool:
        """Whether it checks something whenever it is called."""
        return self.reached(self.function.body)

    def reached(self, statements: Sequence[ast.stmt]) -> bool:
        return any(map(self.check, statements))

    def check(self, node: ast.stmt) -> bool:
        """Whether a check is made whenever this statement is run."""
        match node:
            case ast.Assert(test=test):
                return self.can_fail(test)
            case ast.With(items=items, body=body):
                return any(self.asserts(item.context_expr) for item in items) or self.reached(body)
            case ast.For(iter=iterable, body=body):
                return self.asserts(iterable) or (self.filled(iterable) and self.reached(body))
            case ast.While(test=ast.Constant(value=True), body=body):
                return self.reached(body)
            case ast.If(body=body, orelse=other):
                return self.reached(body) and self.reached(other)
            case ast.Try(body=body, finalbody=last):
                return self.reached(body) or self.reached(last)
            case ast.Expr() | ast.Assign() | ast.Return():
                return self.asserts(node)
        return False

    def can_fail(self, test: ast.expr) -> bool:
        """Whether an assertion says something also where its comprehension meets nothing."""
        match test:
            case ast.BoolOp(op=ast.And(), values=values):
                return any(map(self.can_fail, values))
            case ast.Call(func=ast.Name(id="all"), args=[argument]):
                return self.filled(argument)
            case ast.UnaryOp(op=ast.Not(), operand=ast.Call(func=ast.Name(id="any"), args=[argument])):
                return self.filled(argument)
            case ast.UnaryOp(op=ast.Not(), operand=argument):
                made = self.constants.get(argument.id) if isinstance(argument, ast.Name) else argument
                return not isinstance(made, COMPREHENSIONS) or all(self.filled(part.iter) for part in made.generators)
        return True

    def asserts(self, node: ast.AST) -> bool:
        """Whether something is called here that raises where a thing is wrong."""
        return any(map(self.asserting, calls(node)))

    def asserting(self, call: ast.Call) -> bool:
        name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
        if name in ("raises", "warns", "fail") or name.startswith("assert_"):
            return True
        if any(word.arg == "check" and getattr(word.value, "value", None) is True for word in call.keywords):
            return True
        called = self.called(call)
        return called is not None and called.checks()

    def called(self, call: ast.Call) -> "AssertionReading | None":
        """The function of the tests that is called."""
        name = getattr(call.func, "id", "")
        found = (self.file, self.inner[name]) if name in self.inner else self.file.function(name)
        if found is None or name in self.seen:
            return None
        reading, spread = AssertionReading(*found, self.seen), found[1].args.vararg
        if spread and (more := call.args[len(found[1].args.args) :]):
            reading.constants[spread.arg] = ast.Tuple(more)
        return reading

    def gives_entries(self) -> bool:
        """Whether what it returns or yields is seen to hold an entry."""
        answers = [node.value for node in ast.walk(self.function) if isinstance(node, ast.Return)]
        return all(map(self.filled, answers)) if answers else any(map(self.yields, self.function.body))

    def yields(self, node: ast.stmt) -> bool:
        match node:
            case ast.Expr(value=ast.Yield()):
                return True
            case ast.For(iter=iterable, body=body):
                return self.filled(iterable) and any(map(self.yields, body))
        return False

    def filled(self, node: ast.expr | None) -> bool:
        """Whether this is seen to hold an entry."""
        match node:
            case ast.Tuple(elts=entries) | ast.List(elts=entries) | ast.Set(elts=entries):
                return any(not isinstance(entry, ast.Starred) or self.filled(entry.value) for entry in entries)
            case ast.Dict(keys=keys, values=values):
                return any(key is not None or self.filled(value) for key, value in zip(keys, values))
            case ast.Constant(value=str() | bytes() as value):
                return len(value) > 0
            case ast.BinOp(left=ast.List(), op=ast.Mult(), right=times):
                return self.positive(times)
            case ast.BinOp(left=left, right=right):  # of lists, sets, arrays
                return self.filled(left) or self.filled(right)
            case ast.IfExp(body=body, orelse=other):
                return self.filled(body) and self.filled(other)
            case ast.Subscript(value=value, slice=ast.Slice(lower=None, upper=ast.expr() as upper)):
                return self.positive(upper) and self.filled(value)
            case ast.Name(id=name):
                return self.filled_name(name)
            case ast.Call():
                return self.filled_call(node)
            case ast.ListComp() | ast.SetComp() | ast.GeneratorExp() | ast.DictComp():
                return all(not part.ifs and self.filled(part.iter) for part in node.generators)
        return False

    def filled_name(self, name: str) -> bool:
        """A parameter that the test's mark gives, a constant here, or one that is imported."""
        if name in self.parameters:
            return all(map(self.filled, self.parameters[name]))
        if name in self.constants:
            return self.filled(self.constants[name])
        home, original = self.file.imported.get(name, ("", ""))
        ours = home.partition(".")[0] in ("cosim", "build_fmus", "tests")
        return ours and original.isupper() and len(getattr(import_module(home), original)) > 0

    def filled_call(self, call: ast.Call) -> bool:
        name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
        match name, call:
            case "range", ast.Call(args=bounds):
                numbers = [self.number(bound) for bound in bounds]
                return None not in numbers and len(range(*numbers)) > 0
            case "zip", ast.Call(args=[_, *_] as parts, keywords=words):
                strict = any(word.arg == "strict" and getattr(word.value, "value", None) is True for word in words)
                return any(map(self.filled, parts)) if strict else all(map(self.filled, parts))
            case "map", ast.Call(args=[_, *parts]):
                return all(map(self.filled, parts))
            case "product", ast.Call(args=parts):
                return all(map(self.filled, parts))
            case "eye", ast.Call(args=[size]):
                return self.positive(size)
        if called := self.called(call):
            return called.gives_entries()
        if name in METHODS and isinstance(call.func, ast.Attribute):
            return self.filled(call.func.value)
        return name in GRIDS or (name in PASSED_ON and len(call.args) > 0 and self.filled(call.args[0]))

    def number(self, node: ast.expr) -> int | None:
        """A whole number that stands here, or that a constant is."""
        value = self.constants.get(node.id, node) if isinstance(node, ast.Name) else node
        try:
            found = ast.literal_eval(value)
        except ValueError:
            return None
        return found if isinstance(found, int) else None

    def positive(self, node: ast.expr) -> bool:
        return (self.number(node) or 0) > 0


def assigned(statements: Iterable[ast.stmt]) -> dict[str, ast.expr]:
    """Names that are assigned once, and what."""
    found: dict[str, list[ast.expr]] = {}
    for statement in statements:
        for node in ast.walk(statement):
            for name, value in pairs(node) if isinstance(node, ast.Assign) else ():
                found.setdefault(name, []).append(value)
    names = {name: values[0] for name, values in found.items() if len(values) == 1}
    return {name: value for name, value in names.items() if not mentions(value, name)}


def pairs(node: ast.Assign) -> Iterator[tuple[str, ast.expr]]:
    """`a, b = 1, 2` gives a with 1 and b with 2."""
    for target in node.targets:
        both = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
        for name, value in zip(target.elts, node.value.elts) if both else [(target, node.value)]:
            if isinstance(name, ast.Name):
                yield name.id, value


def mentions(value: ast.expr, name: str) -> bool:
    return any(isinstance(node, ast.Name) and node.id == name for node in ast.walk(value))


def calls(node: ast.AST) -> Iterator[ast.Call]:
    """Calls that are made whenever this is run: none in a lambda, a comprehension or one side of a choice."""
    if isinstance(node, ast.Lambda | ast.IfExp | COMPREHENSIONS):
        return
    if isinstance(node, ast.Call):
        yield node
    for part in ast.iter_child_nodes(node):
        yield from calls(part)


def parametrized(function: ast.FunctionDef) -> dict[str, list[ast.expr]]:
    """Values of a test's parameters as far as they stand at it."""
    found: dict[str, list[ast.expr]] = {}
    for mark in function.decorator_list:
        match mark:
            case ast.Call(func=ast.Attribute(attr="parametrize"), args=[ast.Constant(value=str() as name), rows, *_]):
                found[name] = list(getattr(rows, "elts", [rows]))
            case ast.Call(
                func=ast.Attribute(attr="parametrize"), args=[ast.Tuple(elts=names), ast.List(elts=rows), *_]
            ):
                for k, name in enumerate(names):
                    found[name.value] = [row.elts[k] if isinstance(row, ast.Tuple) else row for row in rows]
    return found
