"""Design spaces: the same parts anywhere, gone on with after a cut, and the front that is one."""

from __future__ import annotations

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import OutputError, axis_ranges, design
from facets.design import (
    MEASURES,
    SKIPPED,
    Space,
    collect,
    designs,
    measure_design,
    measure_designs,
    meets,
    part_of,
)

CONFIG = facets.load("layout")
runs, space = design.exploration.runs, design.exploration.space
SPACE = Space(CONFIG.sensor, CONFIG.range, CONFIG.layout, 60, 1)


def test_designs_are_in_their_bounds_and_the_same_again():
    drawn = designs(SPACE)
    assert len(drawn) == 60
    bounds = np.array(list(SPACE.layout.variables.values()))
    assert (drawn >= bounds[:, 0]).all()
    assert (drawn <= bounds[:, 1]).all()
    space.draw.cache_clear()
    np.testing.assert_array_equal(drawn, designs(SPACE))


#: The paper's own sensor as a design.
OWN = np.array([250.0, 45.0, 0.0, 120.0, 0.85])


def test_a_design_is_what_the_other_commands_say_of_it():
    why, values = measure_design(SPACE, OWN)
    assert why == 0
    found = dict(zip(MEASURES, values, strict=True))
    ranges = axis_ranges(CONFIG.sensor, replace(CONFIG.range, condition=np.inf), np.zeros(6))
    assert found["head_mm"] == 500
    assert found["range_tz_mm"] == pytest.approx(ranges[2].symmetric, rel=1e-3)
    assert found["range_yaw_mrad"] == pytest.approx(1e3 * ranges[5].symmetric, rel=1e-3)


def test_the_limit_that_a_design_breaks_at_rest_is_the_one_told():
    for broken, words in (
        ({"layout": replace(SPACE.layout, least_power=0.2)}, "too little light at rest"),
        ({"rules": replace(CONFIG.range, coarsest=(1e-9,) * 6)}, "too coarse at rest"),
        ({"rules": replace(CONFIG.range, snr=1e9)}, "too little light at rest"),
    ):
        why, values = measure_design(replace(SPACE, **broken), OWN)
        assert SKIPPED[why] == words
        assert np.isnan(values[space.AT_RANGES]).all()
        assert np.isfinite(values[MEASURES.index("condition")]) == ("rules" in broken)


def test_the_front_is_that_of_the_definition():
    """No other design is as good in all and better in one."""
    rng = np.random.default_rng(1)
    table = {name: rng.random(300) for name in MEASURES}
    table["u_tz_um"][:5] = np.nan
    best = space.front(table, ["head_mm", "u_tz_um", "range_yaw_mrad"])
    costs = np.stack([table["head_mm"], table["u_tz_um"], -table["range_yaw_mrad"]], axis=1)
    assert not best[:5].any()
    for mine, is_best in zip(costs[5:], best[5:], strict=True):
        beaten = (costs <= mine).all(axis=1) & (costs < mine).any(axis=1)
        assert is_best == (not beaten.any())


def test_only_what_keeps_the_requirement_is_looked_at():
    space = replace(SPACE, required=True)
    best = np.array([221.0, 53.0, 257.0, 119.75, 1.8])
    fine = replace(space.layout, limit=(*[np.inf] * 2, 0.1, *[np.inf] * 3))
    for layout, reason in ((space.layout, ""), (fine, "not what is required over the volume")):
        assert SKIPPED[measure_design(replace(space, layout=layout), best)[0]] == reason
        assert meets(space.sensor, layout, space.volume) == (not reason)  # the paper's own
    assert not meets(space.sensor, replace(space.layout, least_power=0.05), space.volume)


def test_a_run_goes_on_where_it_was_cut_off_and_makes_nothing_twice(tmp_path, monkeypatch):
    asked = []

    def here(asking, firsts, _):
        asked.append(list(firsts))
        for first in firsts:
            yield first, part_of(asking, first)

    monkeypatch.setattr(runs, "run_in_processes", here)
    short = replace(SPACE, part=20)
    runs.explore(short, tmp_path, {})
    whole = collect(tmp_path)
    kept, cut, _ = runs.parts_in(tmp_path)
    cut.rename(cut.with_name(f".torn{cut.name}"))  # as a run that is killed leaves it
    before = kept.stat().st_mtime_ns
    runs.explore(short, tmp_path, {})
    assert asked == [[0, 20, 40], [20]]
    assert kept.stat().st_mtime_ns == before
    assert not list(cut.parent.glob(".*"))
    for name, column in collect(tmp_path).items():
        if name != "seconds":
            np.testing.assert_array_equal(column, whole[name])


@pytest.mark.slow
def test_a_cluster_gives_the_same_though_a_worker_is_killed(tmp_path):
    distributed = pytest.importorskip("distributed")
    short = replace(SPACE, part=10)
    alone = [part_of(short, first) for first in range(0, short.count, short.part)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as cluster:
        victims = [next(iter(cluster.workers.values())).pid]

        def kill(done, whole):
            if done == 1 and victims:
                os.kill(victims.pop(), signal.SIGKILL)

        runs.explore(short, tmp_path, {}, cluster.scheduler_address, kill)
    assert not victims
    table = collect(tmp_path)
    for name in MEASURES:
        expected = np.concatenate([part[name] for part in alone])
        np.testing.assert_allclose(table[name], expected, rtol=1e-12)


@pytest.mark.slow
def test_the_command_explores_and_refuses(run_in_process, tmp_path):
    words = ("explore", "layout", "--designs", "128", "--folder", "out")
    status, printed, errors = run_in_process(*words)
    assert status == 0, errors
    assert "128 designs" in printed
    assert "range_roll_mrad follows: radius_mm" in printed
    assert (tmp_path / "out" / "front.png").exists()
    assert (tmp_path / "out" / "designs.parquet").exists()
    (tmp_path / "page.html").write_text("mine")
    for more, message in (
        (("--seed", "2"), "another search"),
        (("--report", "page.html", "-d", "new"), "page.html"),
        (("--report", "page.txt", "-d", "new"), ".html"),
    ):
        status, _, errors = run_in_process(*words, *more)
        assert status == 2
        assert message in errors
    assert (tmp_path / "page.html").read_text() == "mine"
    assert not (tmp_path / "new").exists()


#: Variables of all kinds, about the paper's own sensor.
VARIED = {
    "size_mm": (2.0, 20.0), "diameter_mm": (0.2, 4.0), "inclination_deg": (44.7, 45.3),
    "facet_b_azimuth_deg": (119.0, 121.0), "psd_a_height_mm": (-6.0, 6.0),
}  # fmt: skip


@pytest.mark.parametrize(
    "more",
    [{"rules": replace(CONFIG.range, tracking=True), "sensor": facets.load("skewed").sensor},
     {"layout": replace(CONFIG.layout, variables=VARIED)}],
)  # fmt: skip
def test_designs_at_once_have_the_measures_that_they_have_one_by_one(more):
    """All measures, and why a design is skipped."""
    space = replace(SPACE, count=16, **more)
    assert space.plain
    some = designs(space)
    why, values = measure_designs(space, some)
    assert (why == 0).sum() > 2
    for n, x in enumerate(some):
        reason, expected = measure_design(space, x)
        assert why[n] == reason
        np.testing.assert_allclose(values[n], expected, rtol=1e-9)


def test_what_is_not_plain_is_looked_at_one_by_one():
    for more in ({"electronics": facets.Electronics()}, {"apertures": facets.Apertures(rim=2.0)}):
        assert not replace(SPACE, sensor=replace(SPACE.sensor, **more)).plain
    for more in ({"rules": replace(CONFIG.range, whole_spot=False)}, {"required": True}):
        assert not replace(SPACE, **more).plain


def test_a_part_of_another_search_is_not_mixed_in(tmp_path):
    """Two processes may find the folder empty; the second to write notices."""
    table = part_of(replace(SPACE, part=4, count=4), 0)
    runs.write_part(SPACE, tmp_path, 0, table, {})
    with pytest.raises(OutputError, match="another search"):
        runs.write_part(replace(SPACE, seed=2), tmp_path, 60, table, {})
    assert len(runs.parts_in(tmp_path)) == 1
