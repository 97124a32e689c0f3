"""The effects that are known: those of the contract, and those of a user's own file."""

import importlib.util
from collections.abc import Iterable
from pathlib import Path

from cosim.effects.actuator import ActuatorLag, TimeDelay, TorqueDeadband, TorqueGain, TorqueSaturation
from cosim.effects.effect import Effect
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
    """Instances of every concrete `Effect` that a Python file defines. Raises InputError."""
    path = Path(path)
    if not path.is_file():
        raise InputError(Problem(str(path), "a Python file with an Effect", "no such file"))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(Problem(str(path), "a Python file that runs", f"{type(error).__name__}: {error}")) from error
    kinds = [k for k in vars(module).values() if isinstance(k, type) and issubclass(k, Effect) and k.__module__ == path.stem]
    found = tuple(kind() for kind in kinds if not kind.__abstractmethods__)
    if not found:
        raise InputError(Problem(str(path), "at least one class derived from cosim.effects.Effect", "none"))
    unnamed = [type(effect).__name__ for effect in found if not effect.name]
    if unnamed:
        raise InputError(Problem(str(path), "a `name` for every effect", f"none in {', '.join(unnamed)}"))
    return found
