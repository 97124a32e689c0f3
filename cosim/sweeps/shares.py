"""Shares of stable points of a Monte-Carlo sweep, with intervals."""

from collections.abc import Sequence

from attrs import frozen

from cosim.engine.outcome import Outcome
from cosim.sweeps.campaign import Campaign

_DECIDED = (Outcome.CONVERGED, Outcome.GROWING, Outcome.LIMIT_CYCLE, Outcome.DIVERGED)


@frozen
class Share:
    """`stable` of `decided` points with a label were stable; `low`, `high` bound the true share; `undecided` were left
    out.
    """

    label: str
    stable: int
    decided: int
    undecided: int
    low: float
    high: float

    @property
    def value(self) -> float | None:
        """The estimated share; None without a decided point."""
        return self.stable / self.decided if self.decided else None


def interval(stable: int, decided: int, level: float) -> tuple[float, float]:
    """Clopper-Pearson interval of a share: covers at least `level` for every true share."""
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - level)
    low = float(betaincinv(stable, decided - stable + 1, tail)) if stable else 0.0
    high = float(betaincinv(stable + 1, decided - stable, 1.0 - tail)) if stable < decided else 1.0
    return low, high


def shares(campaign: Campaign, level: float) -> list[Share]:
    """The share of all points, then of every label of every axis of choices."""
    outcomes = [finding.outcome for finding in campaign.findings]
    found = [_share("all", outcomes, level)]
    for column, axis in enumerate(campaign.sweep.axes):
        for choice in axis.choices:
            chosen = [o for o, p in zip(outcomes, campaign.points) if p.entries[column] == choice.label]
            found.append(_share(f"{axis.name} {choice.label}", chosen, level))
    return found


def _share(label: str, outcomes: Sequence[str], level: float) -> Share:
    decided = [o for o in outcomes if o in [d.value for d in _DECIDED]]
    stable = sum(o == Outcome.CONVERGED.value for o in decided)
    return Share(label, stable, len(decided), len(outcomes) - len(decided), *interval(stable, len(decided), level))
