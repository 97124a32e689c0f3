"""Report of `cosim stability`: which condition says what, characteristic loci, roots, growth of the twin difference."""

import numpy as np

from cosim.analysis.comparison import Comparison
from cosim.analysis.delay_verdict import AnyDelay
from cosim.analysis.document import notes
from cosim.analysis.evidence import StabilityEvidence
from cosim.analysis.linearisation import LinearLoop
from cosim.analysis.margin import OpenResponse, loci
from cosim.analysis.spectrum import DelayFamily, abscissa, roots
from cosim.analysis.transparency import Hybrid
from cosim.errors import InputError, Problem
from cosim.report.html import Report, Section, Table
from cosim.report.plots import COLOURS, TIME, Colour, Figure, Guide, Mark, Plot, PlotAxis, Series, curves
from cosim.results.provenance import provenance


def stability_report(found: Comparison, loop: LinearLoop, felt: Hybrid | None = None) -> Report:
    """The report of one comparison, with what the hand feels where that is known."""
    unstable = found.evidence is StabilityEvidence.FALSIFIED
    hand = [] if felt is None else [_felt(felt)]
    sections = [_conditions(found), *any_delay_sections(found.any_delay), *_linear(found, loop), *hand, _read(found)]
    facts = provenance(found.judged.result)
    return Report(
        f"Stability of {found.judged.result.scenario.name}",
        _verdict(found),
        sections,
        facts,
        mood="bad" if unstable else "good" if found.evidence is not StabilityEvidence.NONE else "neutral",
    )


def _felt(felt: Hybrid) -> Section:
    """Impedance that the hand feels in free motion and against a remote arm that is held fast, an axis a plot."""
    frequency = PlotAxis("frequency [Hz]", log=True)
    plots = []
    for k, axis in enumerate("xyz"):
        sizes = {"free": np.abs(felt.h11[:, k, k]), "held fast": np.abs(felt.held[:, k, k])}
        series = curves(felt.frequencies, sizes, dashed=["held fast"])
        plots.append(Plot(series, frequency, PlotAxis("|Z| [N·s/m]", log=True), axis, link="frequency", height=220))
    text = (
        "From the linear loop at its start pose, hand and environment taken off. What lies between both curves is the "
        "Z-width (Colgate and Brown 1994): the impedances that the teleoperator can let the hand feel."
    )
    return Section(
        "What the hand feels", text, figures=[Figure(plots, "Impedance at the hand.", columns=3, name="felt")]
    )


def _verdict(found: Comparison) -> str:
    judged = found.judged
    scenario = judged.result.scenario
    changed = f"\n\nThis loop is {scenario.name} {scenario.changed}." if scenario.changed else ""
    rate = "" if judged.growth_rate is None else f" Growth rate {judged.growth_rate:+.5f} 1/s."
    return (
        f"{judged.outcome.advice[0].upper()}{judged.outcome.advice[1:]}.{rate} "
        f"Strongest evidence: {found.evidence.meaning}.{changed}"
    )


def _conditions(found: Comparison) -> Section:
    t = found.theory
    rows = []
    if t.delay_sum and t.sallam_eq10:
        rows += [
            [
                "4 B_l B_r > (T_l + T_r)^2 K_l K_r",
                _says(t.delay_sum.holds),
                t.delay_sum.max_delay,
                t.delay_sum.guarantees,
            ],
            ["Sallam Eq. 10 as printed", _says(t.sallam_eq10.holds), t.sallam_eq10.max_delay, t.sallam_eq10.guarantees],
        ]
    if t.law_bound is not None:
        rows += [
            [
                "scaled small gain, this plant",
                _says(t.known_mass),
                t.law_bound,
                "near the pose, every delay law below the bound",
            ]
        ]
    if t.abscissa is not None:
        says = f"{'unstable' if t.abscissa > 0 else 'stable'} ({t.abscissa:+.5f} 1/s)"
        rows += [["exact spectrum", says, found.max_delay, "near the pose, constant delay; necessary and sufficient"]]
    if found.margins is not None:
        m = found.margins
        rows += [
            [
                "delay margin (python-control)",
                f"phase {m.phase:.4g} deg",
                m.delay,
                "more delay each way until the first crossing",
            ]
        ]
    rate = "" if found.judged.growth_rate is None else f" ({found.judged.growth_rate:+.5f} 1/s)"
    rows += [["co-simulation, twin runs", found.judged.outcome.value + rate, None, "this motion, these delays"]]
    delays = "delays " + ", ".join(f"{d:g} s" for d in t.delays) + (" constant" if t.constant else " on average")
    pose = ", ".join(f"{q:g}" for q in t.pose)
    return Section(
        "What each condition says",
        f"At q = ({pose}) rad, {delays}.",
        [Table(["condition", "says", "largest delay each way [s]", "what that covers"], rows)],
    )


def any_delay_sections(both: AnyDelay | None) -> list[Section]:
    """What holds for every delay law, and the law that destroys: its trace, and how a disturbance grows under it; none
    where it was not asked.
    """
    if both is None:
        return []
    words = []
    if both.certified:
        words.append(
            f"Proven: whatever the delays do between 0 and {both.certified:.4g} s each way, however fast, small motion "
            "about the pose dies out. `cosim verify certificate.json` checks the proof without optimising."
        )
    if both.destroyed_at and both.replay and both.replay.growth_rate is not None:
        words.append(
            f"A delay that stays below {both.destroyed_at:.4g} s makes the FMUs grow at "
            f"{both.replay.growth_rate:+.4g} 1/s (destroying.csv; destroying.toml plays it)."
        )
    if both.gap_percent is not None:
        words.append(f"The two are {both.gap_percent:.2g} % apart; between them nobody knows.")
    words += [f"No {name}: {why}." for name, why in both.withheld.items()]
    figures = []
    if both.destroyer is not None and both.replay is not None:
        figures = [law_figure(both)]
    return [Section("Any delay law", "\n\n".join(words), figures=figures)]


def law_figure(both: AnyDelay) -> Figure:
    """The delay trace that destroys over three periods, and the size of a disturbance from period to period."""
    assert both.destroyer is not None and both.replay is not None and both.system is not None
    ages, step = np.tile(both.destroyer.ages, 3), both.system.step
    time = step * np.arange(ages.shape[1])
    laws = [Series(n, time, step * row, COLOURS[k]) for k, (n, row) in enumerate(zip(both.system.channels, ages))]
    seen, size = both.replay.sizes.T
    grown = Series("difference of twin runs", seen, size, Colour.RED)
    plots = [
        Plot(laws, TIME, PlotAxis("delay [s]"), "Delay law, three periods", height=260),
        Plot([grown], TIME, PlotAxis("joint rates [rad/s]", log=True), "A disturbance", height=260),
    ]
    return Figure(plots, "The delay law that destroys, and a disturbance under it in the FMUs.", columns=2, name="law")


def _says(holds: bool) -> str:
    return "holds" if holds else "does not hold"


def _linear(found: Comparison, loop: LinearLoop) -> list[Section]:
    if loop.family() is None or found.theory.abscissa is None:
        return []
    figure = loop_figure(found, loop)
    text = "Characteristic loci of the loop opened at the channels, with the exact delay; rightmost roots; growth rate."
    if _starts_at_minus_one(figure.plots[0]):
        text += (
            " The loci pass -1 at zero frequency because the free loop is neutral against a common displacement: "
            "nothing holds both arms to one place."
        )
    return [Section("The linearised loop", text, figures=[figure])]


def _starts_at_minus_one(nyquist: Plot) -> bool:
    """Whether a locus begins at -1; at its lowest frequency w the real part differs by O(w^2)."""
    return any(abs(s.x[0] + 1) < 1e-3 and abs(s.y[0]) < 0.05 for s in nyquist.series if s.mark is Mark.LINE)


def loop_figure(found: Comparison, loop: LinearLoop) -> Figure:
    """Characteristic loci, rightmost roots and growth rate against constant delay.

    Raises InputError where the loop has no spectrum.
    """
    family = loop.family()
    if family is None or found.theory.abscissa is None:
        raise InputError(Problem("plot", "a loop with a spectrum", "one without", "see notes in stability.json"))
    plots = [_nyquist(found, family), _roots(loop), _against_delay(found, family)]
    return Figure(plots, "Nyquist, spectrum, growth rate against a constant delay.", columns=3, name="loop")


def _nyquist(found: Comparison, family: DelayFamily) -> Plot:
    responses = [locus.response for locus in loci(OpenResponse.of(family), max(found.theory.delays))[:3]]
    series = [Series(f"locus {k + 1}", r.real, r.imag, COLOURS[k]) for k, r in enumerate(responses)]
    series.append(Series("-1", np.array([-1.0]), np.zeros(1), Colour.RED, Mark.POINTS, symbol="+", size=10.0))
    return Plot(
        series, PlotAxis("Re L [1]", (-2, 1.5)), PlotAxis("Im L [1]", (-1.75, 1.75)), "Characteristic loci", height=260
    )


def _roots(loop: LinearLoop) -> Plot:
    found = roots(loop.system())
    both = np.concatenate([found, found.conj()])
    series = [Series("roots", both.real, both.imag, Colour.BLUE, Mark.POINTS, size=6.0)]
    guide = Guide(0.0, Colour.INK, upright=True)
    return Plot(series, PlotAxis("Re s [1/s]"), PlotAxis("Im s [rad/s]"), "Rightmost roots", height=260, guides=[guide])


def _against_delay(found: Comparison, family: DelayFamily) -> Plot:
    limit = found.max_delay if found.max_delay and np.isfinite(found.max_delay) else None
    top = 1.5 * max([d for d in (*found.theory.delays, limit) if d] + [0.1])
    delays = np.linspace(0.0, top, 25)
    series = curves(delays, {"spectrum": np.array([abscissa(family.at(d)) for d in delays])})
    guides = [Guide(0.0, Colour.INK)]
    if limit:
        guides.append(Guide(limit, Colour.GREY, (6, 3), upright=True, name=f"boundary {limit:.4g} s"))
    judged = found.judged
    if judged.growth_rate is not None and found.theory.constant:
        x, y = np.array([found.theory.delays[0]]), np.array([judged.growth_rate])
        series.append(Series("co-simulation", x, y, Colour.RED, Mark.POINTS, symbol="s", size=7.0))
    axes = PlotAxis("constant delay each way [s]"), PlotAxis("growth rate [1/s]")
    return Plot(series, *axes, "Growth rate", height=260, guides=guides)


def _read(found: Comparison) -> Section:
    ages = [[name, 1e3 * value] for name, value in found.added_ages.items()]
    ports = [[arm, "passive" if p.passive else "not passive", p.damping] for arm, p in found.ports.items()]
    damping = [
        [s.arm, float(s.damping.min()), s.viscosity.value, float(s.effective.min())] for s in found.theory.pair or ()
    ]
    tables = (
        [Table(["arm", "controller B", "plant, least in the workspace", "effective"], damping, "Damping counted on")]
        if damping
        else []
    )
    tables += (
        [Table(["arm", "port", "least real part of its impedance [N s/m]"], ports, "Passivity of the plant's port")]
        if ports
        else []
    )
    tables += [Table(["way", "age added [ms]"], ages, "Mean age that the co-simulation adds")]
    return Section("How to read it", "\n\n".join(notes(found)), tables)
