"""Whether an effect shows, without any tool: what least squares of the nominal model leave, against the floor
of noise."""

import numpy as np
from scipy.linalg import qr

from tests.support.laboratory_a.experiment import DrawnExperiment, rms


def nominal(e: DrawnExperiment, q, v, a):
    """[(columns (K, N), given torque (N,)) of each described joint]: rigid, Coulomb, viscous, as the
    description has them.

    Joints of a PHANToM that is fitted share their first eight columns.
    """
    machine, loop, j = e.machine, e.loop, e.loop.joint
    friction = [np.stack([loop.sign(v[k] / loop.smooth[k]), v[k]]) for k in range(machine.arm.n)]
    nothing = np.zeros(q.shape[1])
    if machine.description == "axis":
        rigid = machine.arm.regressor(q, v, a)[0]
        return [(np.vstack([rigid, friction[0], np.ones_like(nothing)]), nothing)]
    if machine.description == "columns":
        return [(np.vstack([regressor_columns(e, q, v, a), friction[j]]), nothing)]
    if machine.description == "rigid":
        return [(friction[j], given_torque(e, q, v, a))]
    rigid = machine.arm.regressor(q, v, a)
    if machine.description == "phantom declared":
        given = np.einsum("jkn,k->jn", rigid, machine.arm.parameters(machine.rotor))
        return [(friction[k], given[k]) for k in range(3)]
    blocks = []
    for k in range(3):
        block = np.zeros((6, q.shape[1]))
        block[2 * k : 2 * k + 2] = friction[k]
        blocks.append((np.vstack([rigid[k], block]), nothing))
    return blocks


def regressor_columns(e: DrawnExperiment, q, v, a):
    """Independent inertial and gravity columns of the described joint, as a laboratory would write them."""
    arm, j = e.machine.arm, e.loop.joint
    if arm.n == 1:
        return arm.regressor(q, v, a)[0]
    columns = arm.row(j, q, v, a)
    size = rms(columns)
    alive = np.flatnonzero(size > 1e-9 * size.max())
    some = columns[alive][:, :: max(1, columns.shape[1] // 3000)]
    _, r, order = qr((some / size[alive, None]).T, mode="economic", pivoting=True)
    depth = abs(np.diag(r))
    return columns[np.sort(alive[order[depth > 1e-4 * depth[0]]])]


def given_torque(e: DrawnExperiment, q, v, a):
    machine, j = e.machine, e.loop.joint
    if machine.arm.n == 1:
        return machine.arm.parameters(machine.rotor) @ machine.arm.regressor(q, v, a)[0]
    return machine.arm.row_parameters(j, machine.rotor) @ machine.arm.row(j, q, v, a)


def described(e: DrawnExperiment) -> list[int]:
    return [0, 1, 2] if e.machine.description.startswith("phantom") else [e.loop.joint]


def fit(e: DrawnExperiment, q, v, a, u, rows=slice(None)):
    """(parameters, residuals (joints, N)) by ordinary least squares; joints that share columns weighted by
    their noise."""
    blocks = nominal(e, q[:, rows], v[:, rows], a[:, rows])
    joints, residuals, found = described(e), [], []
    if e.machine.description == "phantom fit":
        weight = 1 / e.logger.noise
        left = np.hstack([x * w for (x, _), w in zip(blocks, weight)])
        right = np.concatenate([u[k, rows] * w for k, w in zip(joints, weight)])
        size = rms(left)
        found = np.linalg.lstsq((left / size[:, None]).T, right, rcond=None)[0] / size
        return found, np.stack([u[k, rows] - found @ x for (x, _), k in zip(blocks, joints)])
    for (x, given), k in zip(blocks, joints):
        size = rms(x)
        some = np.linalg.lstsq((x / size[:, None]).T, u[k, rows] - given, rcond=None)[0] / size
        residuals.append(u[k, rows] - given - some @ x)
        found.append(some)
    return np.concatenate(found), np.stack(residuals)
