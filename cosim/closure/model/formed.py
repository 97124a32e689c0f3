"""Columns that do not depend on the fit: formed once for a setting and shared by all models of it."""

from collections.abc import Callable, Hashable, Sequence

import numpy as np
from attrs import define, field

from cosim.closure.model.choice import ChosenEffect
from cosim.closure.model.friction import FrictionLaw
from cosim.closure.model.setting import Setting
from cosim.effects import Effect
from cosim.effects.motion import Columns, Joints, Theta

Laws = tuple[FrictionLaw, ...]
Grid = Sequence[tuple[Theta, Columns]]
"""Values of an effect's nonlinear parameters, each with its filtered columns on the fitted rows."""


@define(eq=False)
class FormedColumns:
    """Filtered columns of one setting, by what they are formed from."""

    setting: Setting
    _signs: dict[tuple[int, FrictionLaw], np.ndarray] = field(factory=dict, init=False, repr=False)
    _delivered: dict[tuple[int, tuple[tuple[Hashable, Theta], ...]], tuple[np.ndarray, np.ndarray]] = field(
        factory=dict, init=False, repr=False
    )
    _static: dict[tuple[Hashable, Joints, Theta, Laws], Columns] = field(factory=dict, init=False, repr=False)
    _grids: dict[tuple[Hashable, Joints, Laws], Grid] = field(factory=dict, init=False, repr=False)

    def sign(self, joint: int, law: FrictionLaw) -> np.ndarray:
        """The smooth sign (m,) of a joint by a friction law."""
        if (joint, law) not in self._signs:
            self._signs[joint, law] = self.setting.sign(joint, law)
        return self._signs[joint, law]

    def delivered(self, joint: int, choices: tuple[ChosenEffect, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Target and slope (m,) of a joint's recorded torque after lags and delays."""
        key = joint, tuple((c.effect.key, c.theta) for c in choices)
        if key not in self._delivered:
            tau = self.setting.motion.tau[:, [joint]]
            for c in choices:
                tau = c.effect.delivered(self.setting.motion, tau, c.theta)
            self._delivered[key] = self.setting.target(joint, tau)
        return self._delivered[key]

    def static(self, choice: ChosenEffect, laws: Laws, form: Callable[[], Columns]) -> Columns:
        """The columns of a choice that does not depend on the model's prediction; `form` forms them the first time."""
        key = choice.effect.key, choice.joints, choice.theta, laws
        if key not in self._static:
            self._static[key] = form()
        return self._static[key]

    def keep(self, choice: ChosenEffect, laws: Laws, columns: Columns) -> None:
        """Columns of a choice that were formed elsewhere, for `static` to return."""
        self._static[choice.effect.key, choice.joints, choice.theta, laws] = columns

    def grid(self, effect: Effect, joints: Joints, laws: Laws, form: Callable[[], Grid]) -> Grid:
        """The columns of an effect at all values of its grid; `form` forms them the first time."""
        key = effect.key, joints, laws
        if key not in self._grids:
            self._grids[key] = form()
        return self._grids[key]
