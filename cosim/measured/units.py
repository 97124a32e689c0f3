"""Units that a description file may name, and their factor to SI."""

import math
from collections.abc import Mapping
from types import MappingProxyType

# unit -> (SI unit, factor). An electrical or counted unit has no factor of its own: it needs a [scale].
FACTORS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "s": ("s", 1.0),
        "ms": ("s", 1e-3),
        "us": ("s", 1e-6),
        "ns": ("s", 1e-9),
        "rad": ("rad", 1.0),
        "deg": ("rad", math.pi / 180),
        "mrad": ("rad", 1e-3),
        "rev": ("rad", 2 * math.pi),
        "m": ("m", 1.0),
        "cm": ("m", 1e-2),
        "mm": ("m", 1e-3),
        "um": ("m", 1e-6),
        "rad/s": ("rad/s", 1.0),
        "deg/s": ("rad/s", math.pi / 180),
        "rpm": ("rad/s", math.pi / 30),
        "m/s": ("m/s", 1.0),
        "mm/s": ("m/s", 1e-3),
        "rad/s^2": ("rad/s^2", 1.0),
        "deg/s^2": ("rad/s^2", math.pi / 180),
        "m/s^2": ("m/s^2", 1.0),
        "mm/s^2": ("m/s^2", 1e-3),
        "N.m": ("N.m", 1.0),
        "mN.m": ("N.m", 1e-3),
        "N.mm": ("N.m", 1e-3),
        "N": ("N", 1.0),
        "mN": ("N", 1e-3),
    }
)
ELECTRICAL: Mapping[str, tuple[str, float]] = MappingProxyType(
    {"V": ("V", 1.0), "mV": ("V", 1e-3), "A": ("A", 1.0), "mA": ("A", 1e-3)}
    | {"duty": ("duty", 1.0), "%": ("duty", 1e-2), "counts": ("counts", 1.0)}
)  # what a torque may be given in without a [scale]: results then carry this unit
NEED_SCALE = tuple(ELECTRICAL)
ANGLE = {"q": "rad", "q_ref": "rad", "dq": "rad/s", "ddq": "rad/s^2", "tau": "N.m"}
LENGTH = {"q": "m", "q_ref": "m", "dq": "m/s", "ddq": "m/s^2", "tau": "N"}
ALLOWED: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "time": frozenset({"s"}),
        "q": frozenset({"rad", "m"}),
        "q_ref": frozenset({"rad", "m"}),
        "dq": frozenset({"rad/s", "m/s"}),
        "ddq": frozenset({"rad/s^2", "m/s^2"}),
        "tau": frozenset({"N.m", "N"}),
        "rigid": frozenset({"N.m", "N"}),
        "force": frozenset({"N"}),
    }
)


NAMES: Mapping[str, str] = MappingProxyType(
    {
        "sec": "s", "secs": "s", "second": "s", "seconds": "s",
        "msec": "ms", "millisecond": "ms", "milliseconds": "ms",
        "usec": "us", "µs": "us", "μs": "us", "microsecond": "us", "microseconds": "us",
        "nsec": "ns", "nanosecond": "ns", "nanoseconds": "ns",
        "°": "deg", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad",
        "°/s": "deg/s", "°/s^2": "deg/s^2", "1/min": "rpm", "µm": "um", "μm": "um",
        "Nm": "N.m", "mNm": "mN.m", "Nmm": "N.mm",
    }
)  # fmt: skip


def spelled(unit: str) -> str:
    """The spelling used here: `N m`, `Nm`, `N*m` -> `N.m`; `rad/s2` -> `rad/s^2`; `µs` -> `us`."""
    plain = unit.strip().replace("²", "^2").replace("·", ".").replace("⋅", ".").replace("*", ".").replace(" ", ".")
    plain = plain[:-1] + "^2" if plain.endswith("/s2") else plain
    return NAMES.get(plain, plain)


def known(unit: str) -> bool:
    """Whether a description may name the unit."""
    return spelled(unit) in FACTORS or spelled(unit) in NEED_SCALE
