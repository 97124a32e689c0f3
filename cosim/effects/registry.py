"""The effects that are known: those of the contract, and those of a user's own file."""

import importlib.util
from collections.abc import Iterable, Mapping
from functools import wraps
from inspect import isfunction
from pathlib import Path

import numpy as np

from cosim.effects.actuator import ActuatorLag, TimeDelay, TorqueDeadband, TorqueGain, TorqueSaturation
from cosim.effects.effect import Effect, Scene
from cosim.effects.load import LoadFriction
from cosim.effects.mounting import BaseTilt, EncoderOffset, Payload
from cosim.effects.position import Hysteresis, PositionFriction, PositionTorque, TorqueRipple
from cosim.effects.speed import CoulombAsymmetry, QuadraticDrag, Stribeck, TorqueOffset, ViscousAsymmetry
from cosim.effects.surroundings import ExternalContact, FrictionDrift, JointCoupling
from cosim.effects.transmission import Backlash, JointElasticity
from cosim.errors import InputError, Problem

BUILT_IN = (
    Stribeck(), CoulombAsymmetry(), ViscousAsymmetry(), TorqueOffset(), LoadFriction(), PositionFriction(), PositionTorque(),
    TorqueRipple(), Hysteresis(), QuadraticDrag(), ActuatorLag(), TimeDelay(), TorqueGain(), TorqueSaturation(), TorqueDeadband(),
    JointElasticity(), Backlash(), Payload(), BaseTilt(), EncoderOffset(), FrictionDrift(), ExternalContact(), JointCoupling(),
)  # fmt: skip


def library(files: Iterable[Path | str] = ()) -> tuple[Effect, ...]:
    """The built-in effects and those that the user's files define. Raises InputError for a file without one."""
    own = tuple(effect for path in files for effect in load_effects(path))
    names = {effect.name for effect in own}
    return (*(effect for effect in BUILT_IN if effect.name not in names), *own)


def load_effects(path: Path | str) -> tuple[Effect, ...]:
    """Instances of every concrete `Effect` that a Python file defines. Raises InputError, as do their methods where they fail."""
    path = Path(path)
    if not path.is_file() or path.suffix != ".py":
        raise InputError(Problem(str(path), "a Python file, named .py, with an Effect", "another name" if path.is_file() else "no such file"))
    kinds = [k for k in vars(_module(path)).values() if isinstance(k, type) and issubclass(k, Effect) and k.__module__ == path.stem]
    whole = [kind for kind in kinds if not kind.__abstractmethods__]
    if not whole:
        lacking = [f"{k.__name__} without {' and '.join(sorted(k.__abstractmethods__))}" for k in kinds]
        raise InputError(Problem(str(path), "at least one class derived from cosim.effects.Effect", ", ".join(lacking) or "none"))
    found = tuple(_made(kind, path) for kind in whole)
    unnamed = [type(effect).__name__ for effect in found if not effect.name]
    if unnamed:
        raise InputError(Problem(str(path), "a `name` for every effect", f"none in {', '.join(unnamed)}"))
    if loose := [type(effect).__name__ for effect in found if isinstance(effect.signals, str)]:
        raise InputError(Problem(str(path), '`signals` as a tuple, such as ("dq",)', f"a text in {', '.join(loose)}"))
    return found


def _module(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(Problem(str(path), "a Python file that runs", f"{type(error).__name__}: {error}")) from error
    return module


def _made(kind: type[Effect], path: Path) -> Effect:
    """An instance of the class with its own methods watched."""
    methods = [name for name, value in vars(Effect).items() if isfunction(value) and getattr(kind, name) is not value]
    watched = {name: _watched(getattr(kind, name), f"{path}: {kind.__name__}.{name}") for name in methods}
    try:
        return type(kind.__name__, (kind,), watched | {"__module__": kind.__module__})()
    except (Exception, SystemExit) as error:
        raise InputError(Problem(f"{path}: {kind.__name__}", "a class that is made without arguments", f"{type(error).__name__}: {error}")) from error


def _watched(method, where: str):
    """The method, with what it raises and columns of another shape told as an InputError that names it."""

    @wraps(method)
    def call(self, *arguments):
        try:
            value = method(self, *arguments)
        except InputError:
            raise
        except (Exception, SystemExit) as error:
            raise InputError(Problem(where, "a method that runs", f"{type(error).__name__}: {error}")) from error
        expected = _EXPECTED.get(method.__name__)
        if expected and not expected[1](value, arguments):
            raise InputError(Problem(where, expected[0], repr(value)[:80]))
        if method.__name__ == "columns" and not _are_columns(value, arguments[0]):
            shapes = {j: np.shape(x) for j, x in value.items()} if isinstance(value, Mapping) else type(value).__name__
            expected = f"joint (from 0) -> array (n, k), n = {len(arguments[0].motion.time)}, the same k for all"
            raise InputError(Problem(where, expected, str(shapes)))
        return value

    return call


def _is_precision(value: object, arguments: tuple) -> bool:
    return isinstance(value, np.ndarray) and value.shape == (arguments[0],) and bool((np.isfinite(value) & (value >= 0)).all())


def _are_all_columns(value: object, arguments: tuple) -> bool:
    scene, _, thetas = arguments
    return isinstance(value, list) and len(value) == len(thetas) and all(_are_columns(columns, scene) for columns in value)


def _are_laws(value: object, scene: Scene) -> bool:
    return isinstance(value, Mapping) and all(
        isinstance(words, str) and _are_columns({0: x}, scene) and np.isfinite(x).all() for words, x in value.items()
    )


_EXPECTED = {
    "precision": ("an array (count,) of finite numbers >= 0", _is_precision),
    "handicap": ("a finite number > 0", lambda value, arguments: isinstance(value, int | float) and 0 < value < np.inf),
    "columns_of_all": ("a list with the columns of each theta", _are_all_columns),
    "other_laws": ("texts, each -> finite array (n, k)", lambda value, arguments: _are_laws(value, arguments[0])),
}


def _are_columns(value: object, scene: Scene) -> bool:
    if not isinstance(value, Mapping) or not value or not set(value) <= set(range(scene.joints)):
        return False
    shapes = {np.shape(x) for x in value.values()}
    return len(shapes) == 1 and len(shape := shapes.pop()) == 2 and shape[0] == len(scene.motion.time) and shape[1] > 0
