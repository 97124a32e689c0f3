"""The wiring of a scenario, checked: units, causality, algebraic loops, order, the delay of each connection."""

from cosim.wiring.ages import direction_table
from cosim.wiring.checking import check, restarted, wire
from cosim.wiring.loops import stepping_order
from cosim.wiring.starts import vector_starts
from cosim.wiring.wiring import DelayPath, Hop, Link, Wiring

__all__ = [
    "DelayPath",
    "Hop",
    "Link",
    "Wiring",
    "check",
    "direction_table",
    "restarted",
    "stepping_order",
    "vector_starts",
    "wire",
]
