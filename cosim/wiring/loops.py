"""Instantaneous influence: algebraic loops, and the order of stepping that follows it."""

from collections.abc import Iterable, Mapping

from cosim.errors import Problem
from cosim.scenario import Scenario
from cosim.signals import FmuDescription, Signal
from cosim.wiring.wiring import Link


def _edges(
    links: Iterable[Link], descriptions: Mapping[str, FmuDescription], assumed: bool
) -> dict[Signal, list[Signal]]:
    """Instantaneous influence between signals: links, and inputs on outputs within an FMU (unstated ones where
    `assumed`).
    """
    edges: dict[Signal, list[Signal]] = {}
    wired: dict[str, list[str]] = {}
    for link in links:
        edges.setdefault(link.source, []).append(link.target)
        wired.setdefault(link.target.component, []).append(link.target.variable)
    for name, inputs in wired.items():
        for output in descriptions[name].outputs:
            through = descriptions[name].variables[output].feedthrough
            acting = (inputs if assumed else []) if through is None else [i for i in inputs if i in through]
            for variable in acting:
                edges.setdefault(Signal(name, variable), []).append(Signal(name, output))
    return edges


def _cycle(edges: dict[Signal, list[Signal]]) -> list[Signal]:
    """One cycle of the graph, empty where there is none (depth-first, iterative)."""
    done: set[Signal] = set()
    for root in edges:
        path, stack = [], [(root, iter(edges.get(root, ())))]
        path.append(root)
        while stack:
            node, following = stack[-1]
            after = next((n for n in following if n not in done), None)
            if after is None:
                done.add(node)
                stack.pop()
                path.pop()
            elif after in path:
                return [*path[path.index(after) :], after]
            else:
                path.append(after)
                stack.append((after, iter(edges.get(after, ()))))
    return []


def loop_problems(links: list[Link], descriptions: Mapping[str, FmuDescription]) -> list[Problem]:
    """Algebraic loops: components that would need one another's value of the same instant."""
    loop = _cycle(_edges(links, descriptions, assumed=False))
    if not loop:
        return []
    return [
        Problem(
            "wiring",
            "no algebraic loop",
            " -> ".join(map(str, loop)),
            "put an FMU with a state or a delay between them",
        )
    ]


def assumed_loops(links: list[Link], descriptions: Mapping[str, FmuDescription]) -> list[str]:
    """A note where FMUs that state no dependencies may close an algebraic loop."""
    loop = _cycle(_edges(links, descriptions, assumed=True))
    if not loop or _cycle(_edges(links, descriptions, assumed=False)):
        return []
    silent = sorted(
        {s.component for s in loop if any(v.feedthrough is None for v in descriptions[s.component].variables.values())}
    )
    return [f"possible algebraic loop {' -> '.join(map(str, loop))}: {', '.join(silent)} states no dependencies"]


def stepping_order(scenario: Scenario, descriptions: Mapping[str, FmuDescription], links: Iterable[Link]) -> list[str]:
    """Order for Gauss-Seidel: sources, then components whose wired inputs act only through states (integrating ones
    first, sampled ones behind them), then the others with every producer of an instantaneous signal ahead of its
    consumer; within a rank as declared.

    So a loop through an arm, a channel and a controller is cut once, at the arm's input, and nowhere else.
    """
    links = list(links)
    fed = {link.target.component for link in links}
    through = _feedthrough(links, descriptions)
    names = list(scenario.components)
    stateful = sorted((n for n in names if n in fed and n not in through), key=lambda n: not descriptions[n].integrates)
    order = [n for n in names if n not in fed] + stateful
    waiting = [n for n in names if n in fed and n in through]
    while waiting:
        ready = [
            n
            for n in waiting
            if not any(
                link.source.component in waiting and link.source.component != n
                for link in links
                if link.target.component == n and link.target.variable in through[n]
            )
        ]
        chosen = ready[0] if ready else waiting[0]
        order.append(chosen)
        waiting.remove(chosen)
    return order


def _feedthrough(links: list[Link], descriptions: Mapping[str, FmuDescription]) -> dict[str, set[str]]:
    """For each component the wired inputs that act at once on one of its wired outputs; components without any are left
    out.
    """
    read = {link.source for link in links}
    found: dict[str, set[str]] = {}
    for link in links:
        name = link.target.component
        for output in descriptions[name].outputs:
            acting = descriptions[name].variables[output].feedthrough
            if Signal(name, output) in read and (acting is None or link.target.variable in acting):
                found.setdefault(name, set()).add(link.target.variable)
    return found
