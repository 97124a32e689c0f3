"""Texts and bytes on their way from FMU to FMU, beside the numbers of the store."""

from collections.abc import Callable, Sequence

from cosim.fmu.contract import Instance
from cosim.wiring import Link, Wiring


def text_carriers(wiring: Wiring, instances: Sequence[Instance]) -> list[Callable[[], None]]:
    """A call for each component that hands the texts over which are wired to it, as their producers have them now.

    A text is held: within a communication step it is the one that its producer had before (Jacobi, or the producer
    comes later), or has just given (Gauss-Seidel).
    """
    by_name = {instance.name: instance for instance in instances}
    return [_carrier(instance, wiring.texts(instance.name), by_name) for instance in instances]


def _carrier(instance: Instance, links: Sequence[Link], by_name: dict[str, Instance]) -> Callable[[], None]:
    def carry() -> None:
        for link in links:
            instance.set_text(link.target.variable, by_name[link.source.component].get_text(link.source.variable))

    return carry
