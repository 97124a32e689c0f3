"""Figures of the two uses of an identified arm: inverse dynamics control (Taati Figs. 14-16) and contact force (Fig.
17).
"""

import numpy as np

from cosim.engine.master import Result
from cosim.report.canvas import BLACK, BLUE, COLOURS, GREY, ORANGE, figure, to_svg
from cosim.report.html import Figure, Section, Table

POINTS = 2000


def application_sections(result: Result) -> list[Section]:
    """Sections for runs that hold an inverse dynamics controller or a force observer; none for others."""
    return [section for section in (_tracking(result), _forces(result)) if section is not None]


def tracking(result: Result, controller: str) -> tuple[np.ndarray, np.ndarray] | None:
    """q_ref and q (n, 3) of the arm that a controller drives, by the wiring; None where it has no reference."""
    wires = {str(c.target): c.source for c in result.scenario.connections}
    reference, measured = wires.get(f"{controller}.q_ref"), wires.get(f"{controller}.q")
    if reference is None or measured is None:
        return None
    return result.vector(str(reference)), result.vector(str(measured))


def _tracking(result: Result) -> Section | None:
    names = [n for n, c in result.scenario.components.items() if c.model == "InverseDynamicsController"]
    loops = {name: pair for name in names if (pair := tracking(result, name)) is not None}
    if not loops:
        return None
    reference = next(iter(loops.values()))[0]
    joint = int(np.ptp(reference, axis=0).argmax())
    thin = slice(None, None, max(len(result.time) // POINTS, 1))
    fig, axes = figure(1, 1, 8.0, 3.2)
    ax = axes[0, 0]
    ax.plot(result.time[thin], reference[thin, joint], color=BLACK, lw=1.0, label="reference")
    for name, colour in zip(loops, (BLUE, ORANGE, *COLOURS[2:]), strict=False):
        ax.plot(result.time[thin], loops[name][1][thin, joint], color=colour, label=f"{name} ({_set(result, name)})")
    ax.set(xlabel="time [s]", ylabel=f"joint {joint + 1} [rad]")
    ax.legend(ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    rows = [[name, _set(result, name), *(_rms(q - ref) * 1e3).tolist()] for name, (ref, q) in loops.items()]
    table = Table(
        ["controller", "its parameters", "q1 [mrad]", "q2 [mrad]", "q3 [mrad]"], rows, "RMS error of each joint."
    )
    return Section("Inverse dynamics control", "", [table], [Figure(to_svg(fig), "As Taati's Figs. 14 to 16.")])


def _set(result: Result, component: str) -> str:
    return result.scenario.components[component].parameter_set or "own parameters"


def _forces(result: Result) -> Section | None:
    names = [n for n, c in result.scenario.components.items() if c.model == "ForceObserver"]
    truth = next((str(c.source) for c in result.scenario.connections if str(c.target).endswith(".f")), None)
    if not names or truth is None:
        return None
    force = result.vector(truth)
    shown = [(names[0], "f", BLUE, "with the model"), (names[0], "f_static", ORANGE, "Jacobian alone")]
    thin = slice(None, None, max(len(result.time) // POINTS, 1))
    fig, axes = figure(2, 1, 8.0, 4.6)
    axes[0, 0].plot(result.time[thin], force[thin, 1], color=BLACK, lw=1.0, label="hand")
    for name, output, colour, label in shown:
        estimate = result.vector(f"{name}.{output}")
        axes[0, 0].plot(result.time[thin], estimate[thin, 1], color=colour, label=label)
        axes[1, 0].plot(result.time[thin], (estimate - force)[thin, 1], color=colour)
    axes[1, 0].axhline(0, color=GREY, lw=0.8)
    axes[0, 0].set_ylabel("force along y [N]")
    axes[1, 0].set(ylabel="error [N]", xlabel="time [s]")
    axes[0, 0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    rows = [
        [f"{n}.{output}", *_rms(result.vector(f"{n}.{output}") - force).tolist()]
        for n in names
        for output in ("f", "f_static")
    ]
    table = Table(
        ["estimate", "x [N]", "y [N]", "z [N]"],
        rows,
        f"RMS error against {truth}, base frame; hand's force on the device.",
    )
    return Section("Contact force", "", [table], [Figure(to_svg(fig), "As Taati's Fig. 17, y up.")])


def _rms(values: np.ndarray) -> np.ndarray:
    """Root mean square (3,) past the first twentieth of the run."""
    return np.sqrt((values[len(values) // 20 :] ** 2).mean(axis=0))
