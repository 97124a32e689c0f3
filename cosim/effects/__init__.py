"""Effects that a model may lack: their physics, columns, signs, aliases and FMU parameters."""

from cosim.effects.effect import Alias, Effect, EffectEstimate, Scene
from cosim.effects.registry import BUILT_IN, library, load_effects

__all__ = ["BUILT_IN", "Alias", "Effect", "EffectEstimate", "Scene", "library", "load_effects"]
