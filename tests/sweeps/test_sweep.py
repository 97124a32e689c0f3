"""Sweeps: the specification, workers that die, the same table for any workers, Dask."""

import json

import numpy as np
import pytest
from attrs import evolve

from cosim.errors import InputError
from cosim.scenario import shipped
from cosim.sweeps.campaign import first_point, run_sweep
from cosim.sweeps.points import PointResult, point, replay
from cosim.sweeps.pool import Here, LocalPool
from cosim.sweeps.shares import interval
from cosim.sweeps.spec import Axis, BoundaryDesign, Choice, Grid, MonteCarlo, Random, Scale, Sweep, load_sweep
from cosim.sweeps.table import columns, summary, units
from tests.support.paths import SUPPORT

A, B = Axis("a", paths=("x.a",), low=0.0, high=1.0, count=6), Axis("b", paths=("x.b",), low=0.0, high=1.0, count=4)


@pytest.fixture(autouse=True)
def models_importable(monkeypatch):
    """Worker processes import `sweep_models` from the folder of the tests."""
    monkeypatch.syspath_prepend(str(SUPPORT))
    monkeypatch.setenv("PYTHONPATH", str(SUPPORT))


GRID = Grid()


def sweep(evaluator="quick", design=GRID, axes=(A, B), **fixed):
    return Sweep("test", "none", tuple(axes), design, evaluator=f"{SUPPORT / 'sweep_models.py'}:{evaluator}", set=fixed)


def test_every_shipped_sweep_loads_and_names_an_existing_scenario():
    names = {path.stem for path in shipped("scenario")}
    sweeps = [load_sweep(path.stem) for path in shipped("sweeps")]
    assert len(sweeps) >= 7
    for found in sweeps:
        assert found.title and found.scenario in names
        assert first_point(found).values


def test_a_bad_sweep_reports_everything_at_once(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(
        'format = 1\nscenaro = "x"\n[[axes]]\nname = "k"\nlow = 2\nhigh = 1\n[[axes]]\nname = "k"\npaths = ["a.b"]\n'
    )
    with pytest.raises(InputError) as caught:
        load_sweep(str(path))
    text = str(caught.value)
    for part in (
        "scenaro",
        "did you mean",
        "one of [grid]",
        "paths or choices",
        "low < high",
        "'k' twice",
        "name of a scenario",
    ):
        assert part in text


def test_a_boundary_needs_numeric_axes(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('scenario = "x"\n[[axes]]\nname = "k"\npaths = ["a.b"]\n[boundary]\ntrace = ["k", "gain"]\n')
    with pytest.raises(InputError, match="gain"):
        load_sweep(str(path))


def test_more_points_than_fit_in_memory_are_refused(tmp_path):
    axes = "".join(f'[[axes]]\nname = "{n}"\npaths = ["a.{n}"]\nlow = 0\nhigh = 1\ncount = 3000\n' for n in "bc")
    for design, count in (("[grid]\n", 9_000_000), ("[random]\ncount = 2000000\n", 2_000_000)):
        (tmp_path / "big.toml").write_text(f'scenario = "x"\n{axes}{design}')
        with pytest.raises(InputError, match=f"at most 1000000, got {count}"):
            load_sweep(str(tmp_path / "big.toml"))


def test_axes_reach_their_ends_exactly_and_turn_back():
    axis = Axis("k", paths=("a.b",), low=0.1, high=10.0, scale=Scale.LOG, count=5)
    assert axis.steps()[0] == 0.1 and axis.steps()[-1] == 10.0
    assert axis.steps()[2] == pytest.approx(1.0)
    assert [axis.share(axis.number(s)) for s in (0.0, 0.3, 1.0)] == pytest.approx([0.0, 0.3, 1.0])


def test_choices_set_several_values_and_may_name_a_scenario():
    axis = Axis("set", choices=(Choice("UR", {"arm_*.parameter_set": "UR"}, "other"),))
    where = point((axis,), axis.steps())
    assert where.entries == ("UR",) and dict(where.values) == {"arm_*.parameter_set": "UR", "scenario": "other"}
    words = replay(evolve(sweep(axes=(axis,)), set={"experiment.stop": 2.0}), where)
    assert words == "cosim run other --set experiment.stop=2.0 --set 'arm_*.parameter_set=\"UR\"'"


def test_keys_are_the_same_in_every_process():
    assert point((A, B), (0.25, 0.5)).key == "b868debc621f785097a9d617"
    assert point((A, B), (0.25, 0.5)).key == point((A, B), (0.25, 0.5)).key != point((A, B), (0.25, 0.75)).key


def test_the_table_is_the_same_for_any_workers(tmp_path):
    described = sweep(design=Random(60, seed=3))
    tables = []
    for name, workers in (("here", Here()), ("one", LocalPool(1)), ("two", LocalPool(2))):
        with workers:
            tables.append(json.dumps(columns(run_sweep(described, tmp_path / name, workers))))
    assert tables[0] == tables[1] == tables[2]


def test_table_files_are_identical_to_the_byte(tmp_path):
    from cosim.results.files import read_table, write_table

    described, files = sweep(), []
    for name, chunk in (("one", 1), ("eight", 8)):
        with Here() as workers:
            campaign = run_sweep(described, tmp_path / name, workers, chunk=chunk)
        files.append(write_table(columns(campaign), units(campaign), {}, tmp_path / f"{name}.h5"))
    assert files[0].read_bytes() == files[1].read_bytes()
    table = read_table(files[0])
    assert list(table)[:5] == ["a", "b", "outcome", "growth_rate", "growth_rate_low"] and len(table["replay"]) == 24
    assert table["growth_rate"][5] == pytest.approx(np.sin(3 * table["a"][5]) + table["b"][5] - 1.0, abs=0)


def test_dead_workers_and_errors_cost_one_retry_then_failed(tmp_path):
    """a = 0: dies twice; 0.2: dies once, then works; 1.0: raises twice; the others are not touched by their neighbours'
    deaths.
    """
    axis = evolve(A, count=6)
    described = sweep("fragile", axes=(axis,), mark=str(tmp_path))
    with LocalPool(2) as workers:
        campaign = run_sweep(described, tmp_path / "out", workers, chunk=3)
    found = dict(zip([p.entries[0] for p in campaign.points], campaign.findings))
    assert [found[a].outcome for a in found] == ["failed", "converged", "converged", "growing", "growing", "failed"]
    assert "SIGSEGV" in found[0.0].message and "no result at 1.0" in found[1.0].message


def test_the_summary_has_the_keys_of_the_contract(tmp_path):
    described = sweep("quick", BoundaryDesign(("a", "b"), cells=4, audit=10), axes=(A, B), pause=0.0)
    with Here() as workers:
        campaign = run_sweep(described, tmp_path, workers, "this process")
    found = json.loads(json.dumps(summary(campaign), allow_nan=False))
    assert {"boundary", "points", "audit", "executor"} <= set(found)
    assert found["points"] == len(campaign.points) and found["executor"] == "this process"
    assert all(len(vertex) == 2 for line in found["boundary"] for vertex in line)


class Wide(Here):
    """As many as `count` chunks at once; remembers how many points each round had."""

    def __init__(self, count):
        self.count, self.rounds = count, []

    def answers(self, task, points, size):
        self.rounds.append(len(points))
        return super().answers(task, points, size)


def test_rounds_are_filled_up_with_points_of_the_audit_and_the_table_stays_the_same(tmp_path):
    described, tables = sweep("quick", BoundaryDesign(("a", "b"), cells=4, audit=60), pause=0.0), []
    for count in (1, 3):
        workers = Wide(count)
        campaign = run_sweep(described, tmp_path / str(count), workers, chunk=4)
        tables.append(json.dumps(columns(campaign)))
        assert sum(workers.rounds) == len(campaign.points) and all(n % (4 * count) == 0 for n in workers.rounds[:3])
    assert tables[0] == tables[1]


def loop_axes():
    return (Axis("stiffness", "N/m", ("c.k",), 0.1, 1.0), Axis("delay", "s", ("c.d",), 0.05, 0.8))


def test_enumerated_axes_give_one_curve_each(tmp_path):
    axes = (Axis("stiffness", "N/m", ("c.k",), values=(0.2, 0.5)), loop_axes()[1])
    described = sweep("exact", BoundaryDesign(("delay",), tolerance=1e-4, cells=4), axes=axes)
    with Here() as workers:
        campaign = run_sweep(described, tmp_path, workers)
    from cosim.analysis.criteria import closed_form

    for curve, stiffness in zip(campaign.curves, (0.2, 0.5)):
        assert curve.others == (("stiffness", stiffness),)
        # the tolerance is 1e-4 of the axis (0.75 s)
        assert curve.lines[0][0][0] == pytest.approx(closed_form(0.06, stiffness, 0.09), abs=0.75e-4)
    assert len(campaign.points) <= 18


def test_monte_carlo_shares_cover_the_truth(tmp_path):
    """P(sin 3a + b < 1) by quadrature, inside the 95 % interval of 300 random points; the intervals are
    Clopper-Pearson's.
    """
    described = sweep(design=MonteCarlo(300, seed=8), pause=0.0)
    with Here() as workers:
        campaign = run_sweep(described, tmp_path, workers)
    share = summary(campaign)["shares"][0]
    grid = (np.arange(1000) + 0.5) / 1000
    truth = np.mean(np.clip(1.0 - np.sin(3 * grid), 0.0, 1.0))
    assert share["interval"][0] < truth < share["interval"][1]
    assert interval(0, 10, 0.95) == pytest.approx((0.0, 0.3085), abs=1e-4)  # published table: 0 of 10
    assert interval(5, 10, 0.95) == pytest.approx((0.1871, 0.8129), abs=1e-4)


def test_rates_for_tracing_follow_the_outcome_where_there_is_no_rate():
    assert (
        PointResult("diverged").rate == 1.0
        and PointResult("converged").rate == -1.0
        and np.isnan(PointResult("failed").rate)
    )
    assert PointResult("growing", 0.2).rate == 0.2


def test_dask_gives_the_same_table(tmp_path):
    import distributed

    from cosim.sweeps.cluster import DaskPool

    described = sweep(design=Random(30, seed=3))
    with Here() as workers:
        expected = json.dumps(columns(run_sweep(described, tmp_path / "here", workers)))
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        DaskPool(cluster.scheduler_address) as workers,
    ):
        found = json.dumps(columns(run_sweep(described, tmp_path / "dask", workers)))
    assert found == expected


def test_no_scheduler_at_the_address_is_bad_input():
    from cosim.sweeps.cluster import DaskPool

    with pytest.raises(InputError, match="Dask scheduler"):
        DaskPool("tcp://127.0.0.1:9", timeout=1.0)
