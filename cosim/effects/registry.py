"""The effects that are known: those of the contract, and those of a user's own file."""

import importlib.util
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from inspect import isfunction
from numbers import Real
from pathlib import Path
from types import ModuleType
from typing import Any, TypeGuard

import numpy as np

from cosim.effects.actuator import ActuatorLag, TimeDelay, TorqueDeadband, TorqueGain, TorqueSaturation
from cosim.effects.effect import Alias, Effect
from cosim.effects.load import LoadFriction
from cosim.effects.mounting import BaseTilt, EncoderOffset, Payload
from cosim.effects.position import Hysteresis, PositionFriction, PositionTorque, TorqueRipple
from cosim.effects.speed import CoulombAsymmetry, QuadraticDrag, Stribeck, TorqueOffset, ViscousAsymmetry
from cosim.effects.surroundings import ExternalContact, FrictionDrift, JointCoupling, JointStop
from cosim.effects.transmission import Backlash, JointElasticity
from cosim.errors import InputError, Problem
from cosim.measured.label import Label
from cosim.opening import named_file

BUILT_IN = (
    Stribeck(),
    CoulombAsymmetry(),
    ViscousAsymmetry(),
    TorqueOffset(),
    LoadFriction(),
    PositionFriction(),
    PositionTorque(),
    TorqueRipple(),
    Hysteresis(),
    QuadraticDrag(),
    ActuatorLag(),
    TimeDelay(),
    TorqueGain(),
    TorqueSaturation(),
    TorqueDeadband(),
    JointElasticity(),
    Backlash(),
    Payload(),
    BaseTilt(),
    EncoderOffset(),
    FrictionDrift(),
    ExternalContact(),
    JointStop(),
    JointCoupling(),
)


def library(files: Iterable[Path | str] = ()) -> tuple[Effect, ...]:
    """The built-in effects and those that the user's files define. Raises InputError for a file without one."""
    files = tuple(files)
    own = tuple(effect for path in files for effect in load_effects(path))
    names = {effect.name for effect in own}
    if twice := sorted(name for name in names if sum(effect.name == name for effect in own) > 1):
        raise InputError(Problem(", ".join(map(str, files)), "every effect once", f"{', '.join(twice)} more than once"))
    return (*(effect for effect in BUILT_IN if effect.name not in names), *own)


def load_effects(path: Path | str) -> tuple[Effect, ...]:
    """Instances of every concrete `Effect` that a Python file defines. Raises InputError, as do their methods where
    they fail.
    """
    wanted = "a Python file, named .py, with an Effect"
    path = named_file(path, wanted)
    if path.suffix != ".py":
        raise InputError(Problem(str(path), wanted, "another name"))
    kinds = [
        k
        for k in vars(_module(path)).values()
        if isinstance(k, type) and issubclass(k, Effect) and k.__module__ == path.stem
    ]
    whole = [kind for kind in kinds if not kind.__abstractmethods__]
    if not whole:
        lacking = [f"{k.__name__} without {' and '.join(sorted(k.__abstractmethods__))}" for k in kinds]
        raise InputError(
            Problem(str(path), "at least one class derived from cosim.effects.Effect", ", ".join(lacking) or "none")
        )
    found = tuple(_made(kind, path) for kind in whole)
    unnamed = [type(effect).__name__ for effect in found if not effect.name]
    if unnamed:
        raise InputError(Problem(str(path), "a `name` for every effect", f"none in {', '.join(unnamed)}"))
    if loose := [type(effect).__name__ for effect in found if isinstance(effect.signals, str)]:
        raise InputError(Problem(str(path), '`signals` as a tuple, such as ("dq",)', f"a text in {', '.join(loose)}"))
    return found


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None, "a file named .py has a loader"
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise InputError(Problem(str(path), "a Python file that runs", f"{type(error).__name__}: {error}")) from error
    return module


def _made(kind: type[Effect], path: Path) -> Effect:
    """An instance of the class, whose own methods are checked when they are called."""
    methods = [name for name, value in vars(Effect).items() if isfunction(value) and getattr(kind, name) is not value]
    checked = {name: _checked(getattr(kind, name), f"{path}: {kind.__name__}.{name}") for name in methods}
    try:
        return type(kind.__name__, (kind,), checked | {"__module__": kind.__module__})()
    except (Exception, SystemExit) as error:
        raise InputError(
            Problem(
                f"{path}: {kind.__name__}", "a class that is made without arguments", f"{type(error).__name__}: {error}"
            )
        ) from error


def _checked(method: Callable[..., Any], where: str) -> Callable[..., Any]:
    """The method; what it raises, or returns against its description, becomes an InputError that names it.

    Labels may be given as texts, such as "stribeck[2]".
    """

    @wraps(method)
    def call(self: Effect, *arguments: Any) -> Any:
        try:
            value = _with_labels(method.__name__, method(self, *arguments))
            expected, holds = _EXPECTED.get(method.__name__, ("", lambda value, arguments: True))
            good = holds(value, arguments)
        except InputError:
            raise
        except (Exception, SystemExit) as error:
            raise InputError(Problem(where, "a method that runs", f"{type(error).__name__}: {error}")) from error
        if not good:
            raise InputError(Problem(where, expected, _shown(value)))
        return value

    return call


def _with_labels(name: str, value: Any) -> Any:
    """What a method returned, with labels in the place of texts."""
    if name in ("labels", "theta_labels") and isinstance(value, tuple | list):
        return tuple(Label.read(text) if isinstance(text, str) else text for text in value)
    if name == "parameters" and isinstance(value, Mapping):
        return {Label.read(key) if isinstance(key, str) else key: number for key, number in value.items()}
    return value


def _shown(value: object) -> str:
    """The value, of columns their kinds and shapes."""
    if isinstance(value, Mapping):
        value = {
            str(key) if isinstance(key, Label) else key: f"{x.dtype} {x.shape}" if isinstance(x, np.ndarray) else x
            for key, x in value.items()
        }
    return repr(value)[:120]


def _finite(value: object) -> TypeGuard[float]:
    return isinstance(value, Real) and bool(np.isfinite(float(value)))


def _is_real(value: object) -> TypeGuard[np.ndarray]:
    """A NumPy array of finite real numbers."""
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and bool(np.isfinite(value).all())


def _is_precision(value: object, arguments: tuple[Any, ...]) -> bool:
    return _is_real(value) and value.shape == (arguments[0],) and bool((value >= 0).all())


def _are_columns(value: object, arguments: tuple[Any, ...]) -> bool:
    scene, *_ = arguments
    if (
        not isinstance(value, Mapping)
        or not value
        or not set(value) <= set(range(scene.joints))
        or not all(map(_is_real, value.values()))
    ):
        return False
    shapes = {x.shape for x in value.values()}
    return len(shapes) == 1 and len(shape := shapes.pop()) == 2 and shape[0] == len(scene.motion.time) and shape[1] > 0


def _are_all_columns(value: object, arguments: tuple[Any, ...]) -> bool:
    return (
        isinstance(value, list)
        and len(value) == len(arguments[-1])
        and all(_are_columns(columns, arguments) for columns in value)
    )


def _are_labels(value: object, arguments: tuple[Any, ...]) -> bool:
    return isinstance(value, tuple) and all(isinstance(label, Label) for label in value)


def _are_values(value: object, arguments: tuple[Any, ...]) -> bool:
    return isinstance(value, Mapping) and all(
        isinstance(label, Label) and _finite(number) for label, number in value.items()
    )


def _is_grid(value: object, arguments: tuple[Any, ...]) -> bool:
    return isinstance(value, tuple | list) and all(
        isinstance(theta, tuple) and all(map(_finite, theta)) for theta in value
    )


def _are_joint_sets(value: object, arguments: tuple[Any, ...]) -> bool:
    known = set(range(arguments[0].joints))
    return isinstance(value, tuple | list) and all(
        isinstance(joints, tuple) and joints and known.issuperset(joints) for joints in value
    )


_COLUMNS = "joint (from 0) -> array (n, k) of finite numbers, n the rows of scene.motion.time, the same k for all"
_TEXT = ("a text", lambda value, arguments: isinstance(value, str))
_EXPECTED: dict[str, tuple[str, Callable[[object, tuple[Any, ...]], bool]]] = {
    "precision": ("an array (count,) of finite numbers >= 0", _is_precision),
    "columns": (_COLUMNS, _are_columns),
    "columns_of_all": (f"a list with the columns of each theta, {_COLUMNS}", _are_all_columns),
    "labels": ("texts in a tuple", _are_labels),
    "theta_labels": ("texts in a tuple", _are_labels),
    "parameters": ("text -> finite number", _are_values),
    "grid": ("tuples of finite numbers in a tuple", _is_grid),
    "joint_sets": ("tuples of joints (from 0) of the device in a tuple", _are_joint_sets),
    "inherent": (
        "aliases in a tuple",
        lambda value, arguments: isinstance(value, tuple) and all(isinstance(alias, Alias) for alias in value),
    ),
    "unseen": (
        "texts in a tuple",
        lambda value, arguments: isinstance(value, tuple) and all(isinstance(kind, str) for kind in value),
    ),
    "untestable": _TEXT,
    "unphysical": _TEXT,
}
