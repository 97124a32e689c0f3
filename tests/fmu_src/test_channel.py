"""The delay channel: what each semantics shows, what each law's numbers are, loss, and the buffer's end."""

import numpy as np
import pytest
from scipy import stats

from tests.support.model_harness import CompiledModel

LAWS = {
    n: i + 1
    for i, n in enumerate(("constant", "sinusoidal", "uniform", "random_walk", "sawtooth", "square", "recorded"))
}
SEMANTICS = {n: i + 1 for i, n in enumerate(("time_delay", "transport_delay", "newest_packet", "packet_order"))}
STEP = 1e-3


def channel(law="constant", semantics="time_delay", first=0.0, **parameters) -> CompiledModel:
    m = CompiledModel("VariableDelayChannel", law=LAWS[law], semantics=SEMANTICS[semantics], **parameters)
    m["u"] = first
    return m.start()


def signal(n: int) -> np.ndarray:
    """A value per step end that names its step: u(t_k) = k, k = 1..n."""
    return np.repeat(np.arange(1.0, n + 1)[:, None], 3, axis=1)


def received(m: CompiledModel, n: int, **more) -> dict:
    return m.run(
        n, STEP, {"u": signal(n), "v": -signal(n), **more}, ("y", "w", "delay_now", "age", "lost", "in_flight")
    )


@pytest.mark.parametrize("semantics", SEMANTICS)
@pytest.mark.parametrize("steps", [0, 1, 7, 300])
def test_constant_delay_shifts_exactly(semantics, steps):
    run = received(channel(semantics=semantics, delay_mean=steps * STEP), 1000)
    expected = np.maximum(np.arange(1, 1001) - steps, 0)
    assert (run["y"] == expected[:, None]).all() and (run["w"] == -expected[:, None]).all()
    assert (run["delay_now"] == steps * STEP).all()


def test_first_input_is_the_past():
    for semantics in SEMANTICS:
        for interpolation in (1, 2):
            run = received(channel(semantics=semantics, first=42.5, delay_mean=0.05, interpolation=interpolation), 60)
            assert (run["y"][:50] == 42.5).all() and (run["y"][50:, 0] == np.arange(1, 11)).all()


def test_linear_interpolation_of_a_part_of_a_step():
    run = received(channel(delay_mean=2.25 * STEP, interpolation=2), 100)
    assert np.abs(run["y"][10:, 0] - (np.arange(11, 101) - 2.25)).max() < 1e-11  # times of 0.1 s carry 1e-17 / 1e-3
    held = received(channel(delay_mean=2.25 * STEP), 100)
    assert (held["y"][10:, 0] == np.arange(11, 101) - 3).all()


def wave(n: int, seed: int = 3) -> np.ndarray:
    """A recorded delay that wanders fast enough to overtake: whole steps, so that ages are exact."""
    random = np.random.default_rng(seed)
    return random.integers(0, 40, n) * STEP


def test_time_delay_reads_the_delay_at_receive_time():
    d = wave(500)
    run = received(channel("recorded"), 500, delay=d)
    k = np.arange(1, 501)
    assert (run["y"][:, 0] == np.maximum(k - np.rint(d / STEP), 0)).all()
    assert np.abs(run["age"][50:, 0] - d[50:]).max() < 1e-12


def arrivals(d: np.ndarray) -> np.ndarray:
    """Arrival step of the packet sent at step k = 0..n (k = 0: the start, with delay d[0] of the recording)."""
    return np.arange(1, len(d) + 1) + np.rint(d / STEP).astype(int)


def oracle(semantics: str, d: np.ndarray) -> np.ndarray:
    """What is shown after each step, by definition: a loop over all packets (the start packet has arrived)."""
    n, at, shown = len(d), arrivals(d), []
    exits = np.maximum.accumulate(at)
    for k in range(1, n + 1):
        sent = np.arange(1, n + 1)
        here = (exits if semantics == "transport_delay" else at) <= k
        candidates = sent[here & (sent <= k)]
        if not len(candidates):
            shown.append(0)
        elif semantics == "packet_order":
            last = at[candidates - 1]
            shown.append(candidates[last == last.max()].max())
        else:
            shown.append(candidates.max())
    return np.array(shown)


@pytest.mark.parametrize("semantics", ["transport_delay", "newest_packet", "packet_order"])
def test_delay_at_send_time_against_the_definition(semantics):
    d = wave(500)
    m = CompiledModel("VariableDelayChannel", law=LAWS["recorded"], semantics=SEMANTICS[semantics])
    m["u"] = 0.0
    m["delay"] = 0.0
    run = received(m.start(), 500, delay=d)
    assert (run["y"][:, 0] == oracle(semantics, d)).all()
    order = np.diff(run["y"][:, 0])
    assert (order >= 0).all() if semantics != "packet_order" else (order < 0).sum() > 50
    assert np.abs(run["age"][:, 0] - (np.arange(1, 501) - run["y"][:, 0]) * STEP).max() < 1e-12


def test_semantics_differ_where_the_delay_varies():
    d = wave(500)
    shown = {s: received(channel("recorded", s), 500, delay=d)["y"][:, 0] for s in SEMANTICS}
    names = list(shown)
    assert all((shown[a] != shown[b]).any() for i, a in enumerate(names) for b in names[:i])
    assert shown["newest_packet"].mean() > shown["packet_order"].mean() > shown["transport_delay"].mean()


def delays(law: str, n: int, **parameters) -> np.ndarray:
    m = CompiledModel("VariableDelayChannel", law=LAWS[law], **parameters).start()
    return m.run(n, STEP, {}, ("delay_now",))["delay_now"][:, 0]


def test_periodic_laws_are_their_functions():
    t = np.arange(1, 5001) * STEP
    limits = {"delay_min": 0.05, "delay_max": 0.25, "delay_period": 1.25}
    turns = t / 1.25 + 0.3
    phase = 0.3 * 2 * np.pi
    sine = delays("sinusoidal", 5000, delay_phase=phase, **limits)
    assert np.abs(sine - (0.15 + 0.1 * np.sin(2 * np.pi * turns))).max() < 1e-14
    away = np.abs(turns * 2 - np.rint(turns * 2)) > 1e-9  # where neither function jumps
    assert (
        np.abs(delays("sawtooth", 5000, delay_phase=phase, **limits) - (0.05 + 0.2 * (turns % 1)))[away].max() < 1e-12
    )
    square = delays("square", 5000, delay_phase=phase, **limits)
    assert (square[away] == np.where(turns % 1 < 0.5, 0.05, 0.25)[away]).all()
    assert square.mean() == pytest.approx(0.15, abs=0.2 * STEP / 5)  # whole periods: one sample at an edge


def test_uniform_knots_are_uniform_and_independent():
    """Knots every 2 ms held: 20000 draws. Kolmogorov-Smirnov and the correlation of neighbours at 1e-4 significance."""
    d = delays("uniform", 40000, delay_min=0.1, delay_max=0.4, delay_interval=2 * STEP, knots=2, seed=5)[1::2]
    assert d.min() >= 0.1 and d.max() < 0.4
    assert stats.kstest((d - 0.1) / 0.3, "uniform").pvalue > 1e-4
    correlation = np.corrcoef(d[:-1], d[1:])[0, 1]
    assert abs(correlation) < 3.9 / np.sqrt(len(d))  # 3.9 standard deviations: 1e-4 two-sided


def test_uniform_knots_joined_by_lines():
    d = delays("uniform", 100000, delay_min=0.0, delay_max=0.3, delay_interval=0.1, seed=7)
    knots = d[99::100]
    t = np.arange(1, 100001) * STEP
    assert np.abs(np.interp(t[99:], t[99::100], knots) - d[99:]).max() < 1e-12
    # 1000 knots: the mean of the lines has about the knots' standard error, 0.3/sqrt(12)/sqrt(1000); variance between
    # is 2/3 of it
    assert abs(d.mean() - 0.15) < 3.9 * 0.3 / np.sqrt(12 * 1000)
    assert abs(d.var() / (2 / 3 * 0.09 / 12) - 1) < 3.9 * 1.2 / np.sqrt(
        1000
    )  # kurtosis below the normal's, neighbours share a knot
    assert stats.kstest(knots / 0.3, "uniform").pvalue > 1e-4


def test_random_walk_stays_in_and_spreads_evenly():
    limits = {"delay_min": 0.1, "delay_max": 0.2, "delay_interval": STEP, "delay_step": 0.04, "knots": 2}
    d = delays("random_walk", 100000, seed=3, **limits)
    steps = np.diff(d)
    assert d.min() >= 0.1 and d.max() <= 0.2 and np.abs(steps).max() <= 0.04
    # reflection keeps the uniform law; the walk mixes over (span/step)^2 * 3 / pi^2 * 2 ~ 4 samples, so every 20th is
    # independent
    assert stats.kstest((d[::20] - 0.1) / 0.1, "uniform").pvalue > 1e-4
    inside = np.abs(d[:-1] - 0.15) < 0.01  # no reflection from here: steps are uniform in +-0.04
    assert stats.kstest((steps[inside] + 0.04) / 0.08, "uniform").pvalue > 1e-4


def test_seeds_differ_and_repeat():
    a, b, c = (delays("uniform", 1000, delay_max=0.3, delay_interval=0.01, seed=s) for s in (1, 1, 2))
    assert (a == b).all() and np.abs(np.corrcoef(a[::10], c[::10])[0, 1]) < 0.39  # 3.9/sqrt(100)


def test_random_numbers_are_splitmix64_in_python_integers():
    def mix(z):
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 % 2**64
        z = (z ^ z >> 27) * 0x94D049BB133111EB % 2**64
        return z ^ z >> 31

    golden = 0x9E3779B97F4A7C15
    start = mix((12345 + golden) % 2**64)
    expected = [(mix((start + golden * (k + 1)) % 2**64) >> 11) / 2**53 for k in range(1, 101)]
    found = delays("uniform", 100, delay_max=1.0, delay_interval=STEP, knots=2, seed=12345)
    assert (found == np.array(expected)).all()


def test_burst_loss_has_gilbert_elliotts_statistics():
    """Rate p/(p+r) of bad states, mean burst 1/r; errors from the chain's correlation time."""
    p, r, n = 0.02, 0.25, 200000
    m = CompiledModel("VariableDelayChannel", loss_to_bad=p, loss_to_good=r, seed=4).start()
    lost = np.diff(m.run(n, STEP, {"u": signal(n)}, ("lost",))["lost"][:, 0], prepend=0)
    rate = p / (p + r)
    memory = (2 - p - r) / (p + r)  # sum of the autocorrelation (1 - p - r)^|k|
    assert abs(lost.mean() - rate) < 3.9 * np.sqrt(rate * (1 - rate) * memory / n)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost, [0]])))
    bursts = edges[1::2] - edges[::2]
    assert abs(bursts.mean() - 1 / r) < 3.9 * np.sqrt((1 - r) / r**2 / len(bursts))
    assert abs((bursts == 1).mean() - r) < 3.9 * np.sqrt(r * (1 - r) / len(bursts))  # geometric


def test_independent_loss_and_what_is_shown():
    m = CompiledModel(
        "VariableDelayChannel", loss_good=0.3, delay_mean=5 * STEP, semantics=SEMANTICS["newest_packet"], seed=9
    ).start()
    run = m.run(20000, STEP, {"u": signal(20000)}, ("y", "lost", "age"))
    assert abs(run["lost"][-1, 0] / 20000 - 0.3) < 3.9 * np.sqrt(0.3 * 0.7 / 20000)
    lost = np.diff(run["lost"][:, 0], prepend=0) > 0
    kept = np.where(lost, 0, np.arange(1, 20001))
    expected = np.concatenate([np.zeros(5), np.maximum.accumulate(kept)[:-5]])
    assert (run["y"][:, 0] == expected).all()


def test_saved_packets_in_flight_go_on():
    """The struct is the whole state: a copy of it continues with the same bits, reordering and loss included."""
    for semantics in SEMANTICS:
        m = channel(
            "uniform", semantics, delay_max=0.3, delay_interval=0.02, loss_to_bad=0.05, loss_to_good=0.3, seed=11
        )
        received(m, 700)
        saved, time = m.memory.copy(), m.time
        first = received(m, 500)
        assert m["in_flight"] > 0
        m.memory[:], m.time = saved, time
        again = received(m, 500)
        assert all((first[k].view(np.uint64) == again[k].view(np.uint64)).all() for k in first)


@pytest.mark.parametrize("semantics", SEMANTICS)
def test_longest_delay_fits_and_a_longer_one_is_refused(semantics):
    fits = received(channel(semantics=semantics, delay_mean=8.0), 9000)
    assert (fits["y"][-1] == 1000).all()
    with pytest.raises(ValueError) as problem:
        received(channel(semantics=semantics, delay_mean=8.3), 9000)
    message = str(problem.value)
    assert all(word in message for word in ("8.3 s", "8192 samples", "8.192 s", "step of 0.001 s")), message


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"law": 3, "delay_min": 0.2, "delay_max": 0.1}, ["delay_max = 0.1", "[0.2, inf)"]),
        ({"law": 4, "delay_max": 0.1, "delay_step": 0.3}, ["delay_step = 0.3", "[0, 0.1]"]),
    ],
)
def test_impossible_parameters(parameters, words):
    with pytest.raises(ValueError) as problem:
        CompiledModel("VariableDelayChannel", **parameters).start()
    assert all(word in str(problem.value) for word in words), problem.value


def test_negative_recorded_delay_is_refused():
    with pytest.raises(ValueError, match="delay = -0.01 s at t = "):
        received(channel("recorded"), 10, delay=np.full(10, -0.01))


def test_variable_communication_steps():
    """Stamps are times, not counters: after steps of 2 ms the delay is still 10 ms."""
    m = channel(delay_mean=0.01, interpolation=2)
    m.run(50, 2e-3, {"u": np.repeat(np.arange(2.0, 101, 2)[:, None], 3, axis=1)}, ("y",))
    m.time = 0.1
    run = m.run(40, 5e-4, {"u": np.repeat(np.arange(100.5, 120.1, 0.5)[:, None], 3, axis=1)}, ("y",))
    assert np.abs(run["y"][:, 0] - np.arange(90.5, 110.1, 0.5)).max() < 1e-9


@pytest.mark.parametrize("semantics", SEMANTICS)
@pytest.mark.parametrize("delay", [1e300, 1.7e308])
def test_absurd_delays_show_the_first_input(semantics, delay):
    run = received(channel(semantics=semantics, first=5.0, delay_mean=delay), 100)
    assert (run["y"] == 5.0).all()
