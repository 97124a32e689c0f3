"""The channel of packets: the same machine as the channel of the papers, twelve numbers together, deadband coding."""

import numpy as np
import pytest

from tests.support.model_harness import CompiledModel

STEP = 1e-3
WAYS = [(semantics, law) for semantics in (1, 2, 3, 4) for law in (1, 2, 3, 4, 5, 6)]
SHOWN = ("delay_now", "age", "lost", "in_flight")
LAW = {"delay_mean": 0.02, "delay_max": 0.05, "delay_interval": 0.01, "delay_period": 0.2, "seed": 6}


def channel(model: str, **parameters: float) -> CompiledModel:
    return CompiledModel(model, **parameters).start()


@pytest.mark.parametrize(("semantics", "law"), WAYS)
def test_six_numbers_arrive_as_those_of_the_channel_of_the_papers(semantics, law):
    """Bit for bit, with bursts of loss: one source serves both."""
    motion = np.random.default_rng(2).standard_normal((500, 12))
    setting = LAW | {"semantics": semantics, "law": law, "loss_to_bad": 0.05, "loss_to_good": 0.3}
    packet = channel("PacketChannel", **setting).run(500, STEP, {"u": motion}, ("y", *SHOWN))
    plain = channel("VariableDelayChannel", **setting).run(
        500, STEP, {"u": motion[:, :3], "v": motion[:, 3:6]}, ("y", "w", *SHOWN)
    )
    assert (packet["y"][:, :6] == np.hstack([plain["y"], plain["w"]])).all()
    assert all((packet[name] == plain[name]).all() for name in SHOWN)
    assert packet["lost"][-1] > 5


def test_all_numbers_of_a_packet_have_one_fate():
    """Number k is k times the first: whatever is lost or overtaken, the twelve that are shown were sent together."""
    first = np.random.default_rng(3).standard_normal(2000)
    setting = LAW | {"semantics": 4, "law": 3, "loss_good": 0.2}
    run = channel("PacketChannel", **setting).run(2000, STEP, {"u": np.outer(first, np.arange(1, 13))}, ("y", "lost"))
    assert (run["y"] == np.outer(run["y"][:, 0], np.arange(1, 13))).all()
    assert run["lost"][-1] > 200 and len(np.unique(run["y"][:, 0])) > 500


def walk(n: int) -> np.ndarray:
    """Twelve numbers that wander away from zero, as motion and forces do."""
    return 1.0 + np.cumsum(np.random.default_rng(4).standard_normal((n, 12)), axis=0) * 0.01


@pytest.mark.parametrize("deadband", [(0.1, 0, 0, 0), (0, 0.02, 0, 0.05), (0.05,) * 4])
def test_deadband_against_its_definition(deadband):
    """A packet goes out when a coded vector has changed by more than its share of the one sent last."""
    u, sent, shown, count = walk(3000), None, [], 0
    for row in u:
        last = np.zeros(12) if sent is None else sent
        change = [np.linalg.norm(row[k : k + 3] - last[k : k + 3]) for k in (0, 3, 6, 9)]
        limit = [d * np.linalg.norm(last[k : k + 3]) for d, k in zip(deadband, (0, 3, 6, 9))]
        if any(d > 0 and c > x for d, c, x in zip(deadband, change, limit)):
            sent, count = row, count + 1
        shown.append(np.zeros(12) if sent is None else sent)
    run = channel("PacketChannel", deadband=deadband).run(3000, STEP, {"u": u}, ("y", "packets", "packet_rate"))
    assert (run["y"] == np.array(shown)).all()
    assert run["packets"][-1] == count and 10 < count < 2000
    assert run["packet_rate"][-1] == pytest.approx(count / 3.0, rel=1e-12)


def test_without_coding_every_sample_is_a_packet():
    run = channel("PacketChannel").run(1000, STEP, {"u": walk(1000)}, ("y", "packets", "packet_rate"))
    assert (run["y"] == walk(1000)).all()
    assert run["packets"][-1] == 1000 and run["packet_rate"][-1] == pytest.approx(1000.0, rel=1e-12)


def test_what_is_shown_differs_by_no_more_than_the_threshold():
    """Weber's law holds at the far end where nothing is delayed or lost, and packets become fewer as it is raised."""
    u, rates = walk(3000), []
    for share in (0.01, 0.03, 0.1):
        run = channel("PacketChannel", deadband=(share, 0, 0, 0)).run(3000, STEP, {"u": u}, ("y", "packet_rate"))
        apart = np.linalg.norm(run["y"][:, :3] - u[:, :3], axis=1)
        assert (apart <= share * np.linalg.norm(run["y"][:, :3], axis=1)).all()
        rates.append(run["packet_rate"][-1, 0])
    assert rates[0] > 2 * rates[1] > 4 * rates[2]


def test_a_lost_packet_counts_as_sent():
    """The sender does not know: a constant signal whose one packet is lost never arrives."""
    u = np.concatenate([np.zeros((5, 12)), np.ones((500, 12))])
    run = channel("PacketChannel", deadband=(0.1, 0, 0, 0), loss_good=1.0).run(
        505, STEP, {"u": u}, ("y", "packets", "lost")
    )
    assert not run["y"].any() and run["packets"][-1] == 1 and run["lost"][-1] == 1


def test_lines_between_coded_packets_are_refused():
    with pytest.raises(ValueError, match=r"deadband\[2\] = 0.1: expected 0 with interpolation = linear"):
        channel("PacketChannel", deadband=(0, 0.1, 0, 0), interpolation=2)
