"""What a teleoperator lets a hand feel, from the linear loop at its start pose: hybrid matrix and Z-width.

The two-port between hand and environment (Hannaford, A design framework for teleoperators with kinesthetic feedback,
IEEE Trans. Robotics and Automation 5, 1989) at a frequency w, 3 x 3 for each entry:

    [ f_h ]   [ H11  H12 ] [ v_l ]        f_h: force of the hand on the local arm, v_l: velocity of its tip,
    [-v_r ] = [ H21  H22 ] [ f_e ]        f_e: force of the remote arm on the environment, v_r: velocity of its tip

A transparent one has H11 = H22 = 0, H12 = 1, H21 = -1. An environment f_e = Z_e v_r is felt as

    Z_t = H11 - H12 Z_e (1 + H22 Z_e)^-1 H21,

in free motion as Z_free = H11, against a remote arm that is held fast as Z_held = H11 - H12 H22^-1 H21. What lies
between the two is the Z-width of the teleoperator (Colgate and Brown, Factors affecting the Z-width of a haptic
display, ICRA 1994). Channels are pure delays of their mean, connections have the age that the stepping gives them.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from attrs import frozen

from cosim.analysis.examination import Examined, examine
from cosim.analysis.linear_fmu import LinearFmu, channel_bounds
from cosim.analysis.linearisation import age_of
from cosim.engine.master import System
from cosim.errors import InputError, Problem
from cosim.scenario import Scenario
from cosim.signals import stem
from cosim.wiring import Wiring

AXES = (1, 2, 3)
FREQUENCIES = tuple(float(f) for f in np.geomspace(0.1, 100.0, 31))
"""Hz: from slow motion of a hand to what its skin feels."""


@frozen(eq=False)
class Hybrid:
    """The hybrid matrix over frequencies (n,) [Hz]: entries (n, 3, 3); H11 in N s/m, H22 in m/(N s), others numbers."""

    frequencies: np.ndarray
    h11: np.ndarray
    h12: np.ndarray
    h21: np.ndarray
    h22: np.ndarray

    @classmethod
    def of(cls, frequencies: Sequence[float], y: np.ndarray) -> "Hybrid":
        """The matrix of admittances y (n, 6, 6): velocities of both tips by forces on them [m/(N s)]."""
        y11, y12, y21, y22 = y[:, :3, :3], y[:, :3, 3:], y[:, 3:, :3], y[:, 3:, 3:]
        h11 = np.linalg.inv(y11)
        across = y21 @ h11
        return cls(np.array(frequencies, dtype=float), h11, h11 @ y12, -across, y22 - across @ y12)

    def felt(self, environment: np.ndarray) -> np.ndarray:
        """Impedance (n, 3, 3) [N s/m] that the hand feels of an environment Z_e (n, 3, 3) or (3, 3) [N s/m]."""
        load = np.linalg.solve(np.eye(3) + self.h22 @ environment, self.h21)
        return self.h11 - self.h12 @ environment @ load

    @property
    def held(self) -> np.ndarray:
        """Impedance (n, 3, 3) [N s/m] felt where the remote arm is held fast."""
        return self.h11 - self.h12 @ np.linalg.solve(self.h22, self.h21)

    def to_dict(self) -> dict[str, object]:
        """Magnitudes over frequency, an axis a column: H11 and Z_held [N s/m], H12, H21, H22 [m/(N s)]."""
        rows = {"h11": self.h11, "h12": self.h12, "h21": self.h21, "h22": self.h22, "z_held": self.held}
        sizes = {name: np.abs(np.einsum("nii->ni", value)).tolist() for name, value in rows.items()}
        return {"frequency": self.frequencies.tolist(), **sizes}


def transparency(scenario: Scenario, system: System, frequencies: Sequence[float] = FREQUENCIES) -> Hybrid:
    """The hybrid matrix of a scenario's teleoperator, on loaded FMUs; hand and environment are taken off.

    Raises InputError for a scenario without two arms that are moved by forces on their tips, and for FMUs that keep
    more than their linear equations tell.
    """
    return hybrid(examine(system.wiring(scenario), system), frequencies)


def hybrid(found: Examined, frequencies: Sequence[float] = FREQUENCIES) -> Hybrid:
    """See `transparency`."""
    ports = _ports(found)
    parts = [_admittance(found, ports, 2j * np.pi * f) for f in frequencies]
    return Hybrid.of(frequencies, np.array(parts))


def _ports(found: Examined) -> list[tuple[str, str, str]]:
    """(arm, input of force, output of velocity) of both ports. Raises InputError where a port is missing."""
    wiring, problems, ports = found.wiring, [], []
    where = f"{wiring.scenario.name}: transparency"
    hidden = [f"{name} {fmu.why}" for name, fmu in found.fmus.items() if fmu.why and fmu.outputs]
    if hidden:
        problems.append(Problem(where, "FMUs that their linear equations tell", "; ".join(hidden)))
    for arm in wiring.scenario.arms or ():
        fmu = found.fmus[arm]
        force = next((n for n in ("f", "f_command") if f"{n}[3]" in fmu.inputs), None)
        velocity = next((n for n in ("dx", "dx_tip") if f"{n}[3]" in fmu.outputs), None)
        if force is None or velocity is None:
            got = f"wired inputs {', '.join(dict.fromkeys(map(stem, fmu.inputs)))}"
            problems.append(Problem(f"{where}: {arm}", "f or f_command, and dx, wired", got))
        else:
            ports.append((arm, force, velocity))
    if not wiring.scenario.arms:
        problems.append(Problem(where, "two arms", "a scenario without"))
    if problems:
        raise InputError(problems)
    return ports


def _admittance(found: Examined, ports: Sequence[tuple[str, str, str]], s: complex) -> np.ndarray:
    """Velocities (6,) of both tips by forces (6,) on them, the links into the ports' `f` cut, at s = jw.

    Where the force of hand or environment is measured (a controller's `f_ext`), it is the one on the tip.
    """
    wiring, fmus = found.wiring, found.fmus
    signals = {name: k for k, name in enumerate(f"{n}.{output}" for n, fmu in fmus.items() for output in fmu.outputs)}
    cut = {f"{arm}.f" for arm, _, _ in ports}
    ages = {str(hop.connection): hop.age for hop in wiring.hops}
    links = {str(link.target): link for link in wiring.links if stem(str(link.target)) not in cut}
    driven = {f"{arm}.{force}[{k}]": 3 * side + k - 1 for side, (arm, force, _) in enumerate(ports) for k in AXES}
    measured = _measured(wiring, ports)
    delays: Mapping[str, float] = {name: bounds[1] for name, bounds in channel_bounds(wiring).items()}
    loop = np.zeros((len(signals), len(signals)), dtype=complex)
    outside = np.zeros((len(signals), 6), dtype=complex)
    for name, fmu in fmus.items():
        gains = _response(fmu, s) * np.exp(-s * delays.get(name, 0.0))
        rows = [signals[f"{name}.{output}"] for output in fmu.outputs]
        for gain, target in zip(gains.T, (f"{name}.{variable}" for variable in fmu.inputs)):
            if target in driven:
                outside[rows, driven[target]] += gain
            if (link := links.get(target)) is not None:
                aged = link.gain * np.exp(-s * age_of(link, wiring, ages))
                place = measured.get(str(link.source))
                if place is None:
                    loop[rows, signals[str(link.source)]] += aged * gain
                else:
                    outside[rows, place] += aged * gain
    moved = np.linalg.solve(np.eye(len(signals)) - loop, outside)
    return moved[[signals[f"{arm}.{velocity}[{k}]"] for arm, _, velocity in ports for k in AXES]]


def _measured(wiring: Wiring, ports: Sequence[tuple[str, str, str]]) -> dict[str, int]:
    """{signal: column of the force} of the signals that are the force on a tip: of a hand, of the wall of an arm."""
    found = {f"{arm}.f_contact[{k}]": 3 * side + k - 1 for side, (arm, _, _) in enumerate(ports) for k in AXES}
    for link in wiring.links:
        for side, (arm, _, _) in enumerate(ports):
            if link.target.component == arm and stem(link.target.variable) == "f":
                found[str(link.source)] = 3 * side + int(link.target.variable[2:-1]) - 1
    return found


def _response(fmu: LinearFmu, s: complex) -> np.ndarray:
    """C (s - A)^-1 B + D."""
    if not fmu.states:
        return fmu.d.astype(complex)
    return fmu.c @ np.linalg.solve(s * np.eye(len(fmu.states)) - fmu.a, fmu.b) + fmu.d
