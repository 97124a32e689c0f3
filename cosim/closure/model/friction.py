"""The friction law of the complete model: which smooth sign a joint's Coulomb friction follows is fitted, not
assumed.
"""

import numpy as np
from attrs import frozen


@frozen
class FrictionLaw:
    """s(dq): "sign", "algebraic" dq / sqrt(dq^2 + w^2), "tanh" tanh(dq / w) or "atan" 2/pi atan(dq / w); width w
    [rad/s].
    """

    form: str = "algebraic"
    width: float = 0.01

    def __call__(self, dq: np.ndarray) -> np.ndarray:
        return _FORMS[self.form](dq, self.width)


_FORMS = {
    "sign": lambda dq, w: np.sign(dq),
    "algebraic": lambda dq, w: dq / np.sqrt(dq * dq + w * w),
    "tanh": lambda dq, w: np.tanh(dq / w),
    "atan": lambda dq, w: 2 / np.pi * np.arctan(dq / w),
}


FORMS = ("algebraic", "tanh", "atan")
"""Forms that have a width, in the order of the FMUs' `coulomb_form`."""


def laws(top_speed: float) -> tuple[FrictionLaw, ...]:
    """Laws to choose from, widths up to a tenth of the top speed [rad/s]."""
    widths = np.geomspace(0.003, 0.12, 7) * top_speed
    return (FrictionLaw("sign", 0.0), *(FrictionLaw(form, float(w)) for form in FORMS for w in widths))
