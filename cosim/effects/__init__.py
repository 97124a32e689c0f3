"""Effects that a model may lack: their physics, columns, signs, aliases and FMU parameters."""

from cosim.effects.effect import Alias, Effect, EffectEstimate
from cosim.effects.registry import BUILT_IN, library, load_effects
from cosim.effects.scene import Scene
from cosim.measured.label import Label

__all__ = ["BUILT_IN", "Alias", "Effect", "EffectEstimate", "Label", "Scene", "library", "load_effects"]
