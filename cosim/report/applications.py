"""Figures of the two uses of an identified arm: inverse dynamics control (Taati Figs. 14-16) and contact force (Fig.
17).
"""

import numpy as np

from cosim.engine.master import Result
from cosim.report.html import Section, Table
from cosim.report.plots import COLOURS, TIME, Colour, Figure, Guide, Plot, PlotAxis, curves


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
    named = {"reference": reference[:, joint]}
    named |= {f"{name} ({_set(result, name)})": q[:, joint] for name, (_, q) in loops.items()}
    series = curves(result.time, named, (Colour.INK, *COLOURS))
    plot = Plot(series, TIME, PlotAxis(f"joint {joint + 1} [rad]"), link="time", height=220)
    rows = [[name, _set(result, name), *(_rms(q - ref) * 1e3).tolist()] for name, (ref, q) in loops.items()]
    table = Table(
        ["controller", "its parameters", "q1 [mrad]", "q2 [mrad]", "q3 [mrad]"], rows, "RMS error of each joint."
    )
    return Section(
        "Inverse dynamics control", "", [table], [Figure([plot], "As Taati's Figs. 14 to 16.", name="joint")]
    )


def _set(result: Result, component: str) -> str:
    return result.scenario.components[component].parameter_set or "own parameters"


def _forces(result: Result) -> Section | None:
    names = [n for n, c in result.scenario.components.items() if c.model == "ForceObserver"]
    truth = next((str(c.source) for c in result.scenario.connections if str(c.target).endswith(".f")), None)
    if not names or truth is None:
        return None
    force = result.vector(truth)
    found = {label: result.vector(f"{names[0]}.{output}")[:, 1] for output, label in _ESTIMATES.items()}
    known = curves(result.time, {"hand": force[:, 1]} | found, (Colour.INK, *COLOURS))
    wrong = curves(result.time, {name: values - force[:, 1] for name, values in found.items()})
    plots = [
        Plot(known, TIME, PlotAxis("force along y [N]"), link="time"),
        Plot(wrong, TIME, PlotAxis("error [N]"), link="time", guides=[Guide(0.0)]),
    ]
    rows = [
        [f"{n}.{output}", *_rms(result.vector(f"{n}.{output}") - force).tolist()]
        for n in names
        for output in _ESTIMATES
    ]
    table = Table(
        ["estimate", "x [N]", "y [N]", "z [N]"],
        rows,
        f"RMS error against {truth}, base frame; hand's force on the device.",
    )
    return Section("Contact force", "", [table], [Figure(plots, "As Taati's Fig. 17, y up.", name="force")])


_ESTIMATES = {"f": "with the model", "f_static": "Jacobian alone"}


def _rms(values: np.ndarray) -> np.ndarray:
    """Root mean square (3,) past the first twentieth of the run."""
    return np.sqrt((values[len(values) // 20 :] ** 2).mean(axis=0))
