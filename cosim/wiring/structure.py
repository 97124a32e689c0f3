"""What is remembered of a wiring's structure: points of a sweep mostly differ in start values only."""

from collections.abc import Callable
from functools import wraps
from typing import TypeVar

from cosim.wiring.wiring import Link, Wiring

Said = TypeVar("Said")
_MOST = 64  # structures, and further arguments, of each function


def of_structure(function: Callable[..., Said]) -> Callable[..., Said]:
    """Remember what a function says of a wiring, which must not depend on start values, and of further arguments.

    Wirings that differ in start values only (`cosim.wiring.restarted`) have their links in common. Without links
    nothing tells one structure from another, and nothing is remembered.
    """
    known: dict[tuple[object, ...], tuple[tuple[Link, ...], Said]] = {}

    @wraps(function)
    def remembered(wiring: Wiring, *rest: object) -> Said:
        if not wiring.links:
            return function(wiring, *rest)
        key = id(wiring.links), *rest
        if key not in known or known[key][0] is not wiring.links:
            if len(known) >= _MOST:
                known.clear()
            known[key] = wiring.links, function(wiring, *rest)
        return known[key][1]

    return remembered
