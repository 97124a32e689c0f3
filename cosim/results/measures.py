"""What a teleoperator does for the hand beside being stable: tracking, energy at its ports, effort, packets.

A port is a force and the velocity of the tip that it acts on, f (n, 3) [N] and v (n, 3) [m/s], as recorded; the power
f v goes into the arm. The hand's port is the local arm with what is wired into its `f`, the environment's the remote
arm likewise; the coupling (controllers and channels) is the two-port between the arms' `f_command`, or `tau` [N.m] with
dq [rad/s]. Integrals over time are by the trapezoidal rule on the recorded rows: their error falls with the square of
the interval between rows (`record_every`).
"""

from collections.abc import Container, Mapping

import numpy as np
from attrs import frozen

from cosim.engine.master import Result
from cosim.engine.table import stacked
from cosim.signals import stem
from cosim.wiring import Wiring


@frozen
class Measure:
    """A number with its unit and what it is, in words."""

    value: float
    unit: str
    meaning: str

    def to_dict(self) -> dict[str, object]:
        """As summary.json has it."""
        return {"value": self.value, "unit": self.unit}


@frozen(eq=False)
class PortRecord:
    """Force and velocity of a port over time, (n, k)."""

    force: np.ndarray
    velocity: np.ndarray

    def work(self, time: np.ndarray) -> np.ndarray:
        """Energy [J] that has gone into the arm until each time (n,): the integral of f v."""
        return _integral(np.einsum("ij,ij->i", self.force, self.velocity), time)

    def impedance(self, time: np.ndarray) -> tuple[float, float, float] | None:
        """Stiffness [N/m] and damping [N s/m] nearest to the force over the motion, along the direction in which the
        force varies most, and the part of its squares that they explain; None where the motion does not tell the two
        apart, or the force stands still.
        """
        moved = np.column_stack([_integral(v, time) for v in self.velocity.T])
        x, v, f = (values - values.mean(axis=0) for values in (moved, self.velocity, self.force))
        if not np.isfinite(f).all() or not f.any():
            return None
        along = np.linalg.svd(f.T @ f)[2][0]
        force, basis = f @ along, np.column_stack([x @ along, v @ along])
        scale = np.linalg.norm(basis, axis=0)
        if not scale.all():
            return None
        found, _, rank, _ = np.linalg.lstsq(basis / scale, force, rcond=1e-6)
        left = force - basis / scale @ found
        return None if rank < 2 else (*(found / scale).tolist(), 1.0 - float(left @ left / (force @ force)))


def _integral(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])


def energies(result: Result, wiring: Wiring) -> dict[str, np.ndarray]:
    """Energy [J] over time (n,): what hand and environment have put into the arms, and what the coupling has taken
    from them at both ports together; empty without two arms.

    A coupling that is passive never gives back more than it was given and has stored at the start, E(t) >= -E(0)
    (Hannaford and Ryu, Time-domain passivity control of haptic interfaces, IEEE Trans. Robotics and Automation 18,
    2002, Eq. 3).
    """
    return _energies(_ports(result, wiring), result.time)


def _energies(ports: Mapping[str, list[PortRecord]], time: np.ndarray) -> dict[str, np.ndarray]:
    signs = {"hand": 1.0, "environment": 1.0, "coupling": -1.0}
    return {name: signs[name] * np.sum([p.work(time) for p in sides], axis=0) for name, sides in ports.items() if sides}


def _ports(result: Result, wiring: Wiring) -> dict[str, list[PortRecord]]:
    """The ports that are there, of hand, environment and coupling; a wall of an arm counts where it was touched."""
    found: dict[str, list[PortRecord]] = {}
    for name, places in port_places(wiring, result.signals).items():
        records = [(p.wall, PortRecord(p.forces(result.signals), p.velocities(result.signals))) for p in places]
        found[name] = [record for wall, record in records if record.force.any() or not wall]
    return found


@frozen
class PortPlace:
    """The signals of a port: for each axis the force as (signal, gain, shift), force = gain signal + shift, and the
    velocity. wall: it is a wall that is part of the arm.
    """

    force: tuple[tuple[str, float, float], ...]
    velocity: tuple[str, ...]
    wall: bool = False

    def forces(self, signals: Mapping[str, np.ndarray]) -> np.ndarray:
        """Forces (n, k) of recorded signals."""
        names, gains, shifts = zip(*self.force, strict=True)
        return stacked(signals, names) * np.array(gains) + np.array(shifts)

    def velocities(self, signals: Mapping[str, np.ndarray]) -> np.ndarray:
        """Velocities (n, k) of recorded signals."""
        return stacked(signals, self.velocity)


def port_places(wiring: Wiring, signals: Container[str]) -> dict[str, list[PortPlace]]:
    """The ports of hand, environment and coupling whose signals are among those given; none without two arms."""
    local, remote = wiring.scenario.arms or ("", "")
    places = {
        "hand": [(local, "f")],
        "environment": [(remote, "f")],
        "coupling": [(arm, kind) for arm in (local, remote) for kind in ("f_command", "tau")],
    }
    return {
        name: [p for arm, kind in where if arm and (p := _place(wiring, signals, arm, kind)) is not None]
        for name, where in places.items()
    }


def _place(wiring: Wiring, signals: Container[str], arm: str, kind: str) -> PortPlace | None:
    """The port of an arm at its input `f`, `f_command` or `tau`; None where nothing is wired, or it is not recorded.

    A wall that is part of the arm (`f_contact`) stands in for what is wired into `f`.
    """
    sources = {link.target.variable: link for link in wiring.links if link.target.component == arm}
    links = [sources.get(name) for name in wiring.descriptions[arm].elements(kind)]
    names = ("dq",) if kind == "tau" else ("dx_tip", "dx")
    moved = next((n for n in names if links and f"{arm}.{n}[{len(links)}]" in signals), None)
    if moved is None:
        return None
    velocity = tuple(f"{arm}.{moved}[{k + 1}]" for k in range(len(links)))
    wired = [link for link in links if link is not None and str(link.source) in signals]
    if len(wired) == len(links):
        return PortPlace(tuple((str(link.source), link.gain, link.shift) for link in wired), velocity)
    if kind == "f" and not any(links) and f"{arm}.f_contact[3]" in signals:
        return PortPlace(tuple((f"{arm}.f_contact[{k + 1}]", 1.0, 0.0) for k in range(3)), velocity, wall=True)
    return None


def port_signals(wiring: Wiring) -> set[str]:
    """What the measures read: stems of the forces wired into both arms, of their velocities, of packets counted."""
    arms = wiring.scenario.arms or ()
    inputs = {f"{arm}.{kind}" for arm in arms for kind in ("f", "f_command", "tau")}
    forces = {stem(str(link.source)) for link in wiring.links if stem(str(link.target)) in inputs}
    moved = {f"{arm}.{name}" for arm in arms for name in ("dx", "dx_tip", "dq", "f_contact")}
    return forces | moved | {f"{name}.packets" for name in wiring.scenario.components}


def measures(result: Result, wiring: Wiring) -> dict[str, Measure]:
    """The measures of a run that has what they need, by name.

    force_tracking: RMS of |f_h + f_e|, the forces of hand and environment on their arms: zero where the hand feels what
    the environment does (Lawrence, Stability and transparency in bilateral teleoperation, IEEE Trans. Robotics and
    Automation 9, 1993). hand_effort: RMS of |f_h|. hand_work: the integral of the positive part of f_h v_l, what the
    hand had to give. energy_*: see `energies`, at the end; coupling_least: the least energy of the coupling, negative
    where it has given more than it was given. felt_*: the spring and damper that are nearest to what the hand felt,
    f_h = stiffness x_l + damping v_l by least squares over the run along the direction in which f_h varies most, x_l
    the integral of v_l and every signal less its mean; explained: the part of the squares that they account for.
    met_*: the same of the environment, -f_e over x_r and v_r: a transparent teleoperator has felt what was met.
    packets: sent a second by all channels (Hinterseer et al., IEEE Trans. Signal Processing 56, 2008).
    """
    if result.scenario.arms is None or len(result.time) < 2:
        return {}
    with np.errstate(over="ignore", invalid="ignore"):  # of a run that diverged
        found = _measures(result, wiring)
    return {name: m for name, m in found.items() if np.isfinite(m.value)}


def _measures(result: Result, wiring: Wiring) -> dict[str, Measure]:
    ports = _ports(result, wiring)
    hand, wall = (next(iter(ports[name]), None) for name in ("hand", "environment"))
    found: dict[str, Measure] = {}
    if hand is not None:
        power = np.einsum("ij,ij->i", hand.force, hand.velocity)
        given = float(_integral(np.maximum(power, 0.0), result.time)[-1])
        found["hand_effort"] = Measure(_rms(hand.force), "N", "RMS of the hand's force")
        found["hand_work"] = Measure(given, "J", "work that the hand had to give")
    if hand is not None and wall is not None:
        apart = _rms(hand.force + wall.force)
        found["force_tracking"] = Measure(apart, "N", "RMS of |f_h + f_e|, forces of hand and environment")
    for name, side in (("felt", hand), ("met", wall and PortRecord(-wall.force, wall.velocity))):
        if side is not None and (impedance := side.impedance(result.time)) is not None:
            who = "hand felt" if name == "felt" else "environment was"
            found[f"{name}_stiffness"] = Measure(impedance[0], "N/m", f"the spring that the {who}")
            found[f"{name}_damping"] = Measure(impedance[1], "N s/m", f"the damper that the {who}")
            words = f"part of the {who.split()[0]}'s force that its spring and damper explain"
            found[f"{name}_explained"] = Measure(impedance[2], "1", words)
    for name, energy in _energies(ports, result.time).items():
        found[f"energy_{name}"] = Measure(float(energy[-1]), "J", _ENERGY[name])
        if name == "coupling":
            found["coupling_least"] = Measure(
                float(energy.min()) + 0.0, "J", "least energy that the coupling ever held"
            )
    if (rate := packets(result, wiring)) is not None:
        found["packets"] = Measure(rate, "1/s", "packets sent a second, all channels together")
    return found


_ENERGY: Mapping[str, str] = {
    "hand": "energy that the hand has put into the local arm",
    "environment": "energy that the environment has put into the remote arm",
    "coupling": "energy that the coupling has taken from both arms",
}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(values**2, axis=1))))


def packets(result: Result, wiring: Wiring) -> float | None:
    """Packets a second: what a channel counts in `packets`, else one at each of its steps; None without a channel."""
    span, rates = float(result.time[-1] - result.time[0]), []
    for name, description in wiring.descriptions.items():
        if not {"delay_now", "in_flight"} <= set(description.variables):
            continue
        counted = result.signals.get(f"{name}.packets")
        every = wiring.scenario.components[name].step_multiple * wiring.scenario.experiment.step
        rates.append(1.0 / every if counted is None else float(counted[-1] - counted[0]) / span)
    return sum(rates) if rates else None
