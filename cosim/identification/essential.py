"""Essential parameters: what stays of a model when what the data cannot tell from zero is taken out."""

import numpy as np

from cosim.identification.identification import Identification
from cosim.identification.stack import with_columns
from cosim.measured.label import Label

SURE = 1.96
"""Standard deviations from zero: the 95 % interval leaves zero out."""


def essential(found: Identification) -> tuple[Label, ...]:
    """The least sure parameter is taken out, the others are fitted again, until every interval leaves zero out.

    Standard deviations are those of white residuals times what their correlation made of them on the whole model.
    """
    base = with_columns(found.stack, found.identifiability.base)
    y, tau, joint, _ = base.equations(base.fit)
    residual = tau - y @ found.params[list(found.identifiability.base)]
    spread = np.array([np.sqrt(np.mean(residual[joint == j] ** 2)) for j in range(base.tau.shape[1])])
    root = 1 / np.maximum(spread, 1e-12)[joint]
    triangle = np.asarray(np.linalg.qr(np.column_stack([y, tau]) * root[:, None], mode="r"))
    correlated = float(np.median(found.spread.std / np.maximum(found.spread.std_white, 1e-300)))
    kept = list(range(y.shape[1]))
    while kept:
        part = triangle[:, [*kept, -1]]
        small = np.asarray(np.linalg.qr(part, mode="r"))
        inverse = np.linalg.inv(small[: len(kept), : len(kept)])
        params = inverse @ small[: len(kept), -1]
        sure = np.abs(params) / (correlated * np.sqrt((inverse**2).sum(axis=1)))
        if sure.min() > SURE:
            break
        del kept[int(np.argmin(sure))]
    return tuple(base.labels[k] for k in kept)
