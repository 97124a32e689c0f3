"""Columns that do not depend on the fit: formed once for a setting and shared by all models of it."""

from collections.abc import Hashable
from typing import Any, TypeVar

import numpy as np
from attrs import define, field

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.setting import Setting
from cosim.effects.actuator import Erasing
from cosim.effects.motion import Columns

Kept = dict[Hashable, np.ndarray]
Value = TypeVar("Value")
STATIC = 24  # laws kept with their values: those of a model, and the steps of a search from it
BASES = 4  # kept of each joint: with and without the tangent, of the model before and of the one at hand


@define(eq=False)
class FormedColumns:
    """Filtered columns of one setting, by what they are formed from: of the complete model (base), of smooth signs, of
    effects (static), of whole grids of effects and of families, for the fitted rows and as they were formed last
    (grids).
    """

    setting: Setting
    base: Kept = field(factory=dict, init=False, repr=False)
    signs: Kept = field(factory=dict, init=False, repr=False)
    static: dict[Hashable, Columns] = field(factory=dict, init=False, repr=False)
    grids: dict[Hashable, tuple[Hashable, Any]] = field(factory=dict, init=False, repr=False)
    _erased: dict[Hashable, tuple[np.ndarray, np.ndarray]] = field(factory=dict, init=False, repr=False)

    def keep_base(self, key: Hashable, columns: np.ndarray) -> None:
        """Keep columns of the complete model: each search for a friction law leaves some that no model has any more."""
        _keep(self.base, key, columns, BASES * self.setting.joints)

    def keep_static(self, key: Hashable, columns: Columns) -> None:
        """Keep columns of an effect: each step of a search leaves some."""
        _keep(self.static, key, columns, STATIC)

    def forget(self) -> None:
        """Let go what would only save time in another search."""
        self.base.clear()
        self.signs.clear()
        self.grids.clear()

    def erased(self, joint: int, choices: tuple[ChosenEffect, ...]) -> tuple[np.ndarray, np.ndarray]:
        """The torque (m,) of a joint that is not delivered, filtered, and the share (m,) of each row's kernel whose
        torque stays what it was but for a constant.
        """
        key = joint, tuple((c.effect.key, c.theta) for c in choices)
        if key not in self._erased:
            m, rows = self.setting.motion, self.setting.rows

            def delivered(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                left = np.ones(len(u), bool)
                for choice in sorted(choices, key=lambda c: c.effect.name):  # the dead band first
                    assert isinstance(choice.effect, Erasing)
                    u, keeps = choice.effect.delivered(u, choice.theta)
                    left &= keeps
                return u, left

            lost = m.of_torque(joint, lambda u: u - delivered(u)[0])
            left = m.of_torque(joint, lambda u: delivered(u)[1].astype(float))
            parts = [rows.filtered(x[:, None], False)[:, 0] for x in (lost, left)]
            self._erased[key] = parts[0], np.clip(parts[1], 0.0, 1.0)
        return self._erased[key]


def _keep(kept: dict[Hashable, Value], key: Hashable, value: Value, most: int) -> None:
    """Keep a value, and let the oldest go where there are many."""
    kept[key] = value
    while len(kept) > most:
        del kept[next(iter(kept))]
