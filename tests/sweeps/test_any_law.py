"""Certificates for every delay law in a sweep: the column of evidence, and the curves on the map."""

import cosim
from cosim.analysis.evidence import StabilityEvidence
from cosim.sweeps import curves
from cosim.sweeps.campaign import task_of
from cosim.sweeps.spec import Axis, BoundaryDesign, Grid, Sweep

STEP = 0.04
FIXED = {"experiment.step": STEP, "experiment.stop": 12.0, "arm_*.parameter_set": "GCW"}
PATHS = ("channel_*.delay_mean",)


def evidence(any_delay: bool) -> list[str]:
    """At delays below the sum condition's 0.36 s, at it, and above the boundary of constant delays."""
    delay = Axis("delay", "s", PATHS, values=(0.28, 0.36, 0.44))
    spec = Sweep("law", "eq10-counterexample", (delay,), Grid(), set=FIXED, any_delay=any_delay)
    return cosim.sweep(spec, workers=1).to_dataframe()["evidence"].tolist()


def test_a_point_that_nothing_cheap_proves_is_proven_by_a_certificate_where_that_is_asked_for():
    mass, growing = StabilityEvidence.ANY_MASS.value, StabilityEvidence.FALSIFIED.value
    assert evidence(any_delay=False) == [mass, StabilityEvidence.CONSTANT_DELAY.value, growing]
    assert evidence(any_delay=True) == [mass, StabilityEvidence.ANY_LAW.value, growing]


def test_the_map_shows_what_is_safe_for_every_law_below_what_a_law_and_a_constant_delay_destroy(monkeypatch):
    monkeypatch.setattr(curves, "LAW_SAMPLES", 1)
    monkeypatch.setattr(curves, "SAMPLES", 1)
    stiffness = Axis("stiffness", "N/m", ("controller_*.stiffness",), 0.25, 0.3)
    delay = Axis("delay", "s", PATHS, 0.2, 0.6)
    names = ("any_law", "destroying_law", "spectrum")
    sweep = Sweep("map", "eq10-counterexample", (stiffness, delay), BoundaryDesign(("stiffness", "delay")),
                  set=FIXED, curves=names)  # fmt: skip
    found = curves.theory_curves(sweep, task_of(sweep), stiffness, delay, {})
    assert list(found) == list(names)
    ((at, safe),), ((_, destroyed),), ((_, constant),) = found.values()
    assert at == 0.25 and 0.36 <= safe < destroyed <= constant + STEP  # laws are made of whole steps
    other = curves.theory_curves(sweep, task_of(sweep), delay, stiffness, {})
    assert other["any_law"] == [] and other["destroying_law"] == []  # along a gain nothing is said
