"""Design spaces: the same parts anywhere, gone on with after a cut, and the front that is one."""

from __future__ import annotations

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import OutputError, axis_ranges
from facets.design import (
    MEASURES,
    NO_RIVALS,
    SKIPPED,
    Space,
    collect,
    designs,
    measure_design,
    measure_designs,
    meets,
    part_of,
)
from facets.design import exploration as study

CONFIG = facets.load("layout")
SPACE = Space(CONFIG.sensor, CONFIG.range, CONFIG.layout, "sobol", 60, 1)


def test_designs_are_in_their_bounds_and_the_same_again():
    for sampling in ("sobol", "lhs", "grid"):
        space = replace(SPACE, sampling=sampling)
        drawn = designs(space)
        assert len(drawn) >= 60
        bounds = np.array(list(space.layout.variables.values()))
        assert (drawn >= bounds[:, 0] - 1e-9).all()
        assert (drawn <= bounds[:, 1] + 1e-9).all()
        study.draw.cache_clear()
        np.testing.assert_array_equal(drawn, designs(space))


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
        assert np.isnan(values[study.AT_RANGES]).all()
        assert np.isfinite(values[MEASURES.index("condition")]) == ("rules" in broken)


def test_the_front_is_that_of_the_definition():
    """No other design is as good in all and better in one."""
    rng = np.random.default_rng(1)
    table = {name: rng.random(300) for name in MEASURES}
    table["u_tz_um"][:5] = np.nan
    best = study.front(table, ["head_mm", "u_tz_um", "range_yaw_mrad"])
    costs = np.stack([table["head_mm"], table["u_tz_um"], -table["range_yaw_mrad"]], axis=1)
    assert not best[:5].any()
    for mine, is_best in zip(costs[5:], best[5:], strict=True):
        beaten = (costs <= mine).all(axis=1) & (costs < mine).any(axis=1)
        assert is_best == (not beaten.any())


#: Of a plain sensor no design is skipped: this one has electronics.
PILOTED = replace(
    SPACE, sensor=replace(SPACE.sensor, electronics=facets.Electronics()), part=40, count=240
)


@pytest.mark.slow
def test_what_is_skipped_is_not_on_the_front():
    """After the pilot, of which nothing is skipped, a part follows: the front without skipping has
    the same designs, and the skipped are a good part of all."""
    count = PILOTED.pilot
    pilot = [part_of(PILOTED, first, NO_RIVALS) for first in range(0, count, PILOTED.part)]
    full = part_of(replace(PILOTED, every=True), count, NO_RIVALS)
    table = {name: np.concatenate([part[name] for part in pilot]) for name in MEASURES}
    best = study.front(table, list(SPACE.objectives))
    rivals = np.stack([column[best] for column in table.values()], axis=1)
    for objectives in (
        ("head_mm", "u_roll_urad", "range_roll_mrad"),
        ("range_tz_mm", "range_yaw_mrad"),
        ("u_tz_um", "condition"),
    ):
        short = part_of(replace(PILOTED, objectives=objectives), count, rivals)
        assert (short["skipped"] == SKIPPED[5]).sum() > 0.2 * PILOTED.part
        fronts = []
        for last in (full, short):
            table = {name: np.concatenate([t[name] for t in [*pilot, last]]) for name in full}
            fronts.append(table["design"][study.front(table, list(objectives))])
        np.testing.assert_array_equal(*fronts)


def test_only_what_keeps_the_requirement_is_looked_at():
    space = replace(SPACE, required=True)
    best = np.array([221.0, 53.0, 257.0, 119.75, 1.8])
    fine = replace(space.layout, limit=(*[np.inf] * 2, 0.1, *[np.inf] * 3))
    for layout, reason in ((space.layout, ""), (fine, "not what is required over the volume")):
        assert SKIPPED[measure_design(replace(space, layout=layout), best)[0]] == reason
        assert meets(space.sensor, layout, space.volume) == (not reason)  # the paper's own
    assert not meets(space.sensor, replace(space.layout, least_power=0.05), space.volume)


def test_a_singular_design_is_told():
    volume = (0.0, 0.0, 3.0, 0.02, 0.02, 0.02, 0.0, 0.0)
    layout = replace(CONFIG.layout, variables={"power_mw": (0.2, 0.4)}, volume=volume)
    for name, regular in (("paper", 1.0), ("singular", 0.0)):
        space = replace(SPACE, sensor=facets.load(name).sensor, layout=layout)
        _, values = measure_design(space, np.array([0.3]))
        assert values[MEASURES.index("regular")] == regular


def test_a_run_goes_on_where_it_was_cut_off_and_makes_nothing_twice(tmp_path, monkeypatch):
    asked = []

    def here(space, firsts, rivals, _):
        asked.append(list(firsts))
        for first in firsts:
            yield first, part_of(space, first, rivals)

    monkeypatch.setattr(study, "run_in_processes", here)
    space = replace(SPACE, part=20)
    study.explore(space, tmp_path, {})
    whole = collect(tmp_path)
    kept, cut, _ = study.parts_in(tmp_path)
    cut.rename(cut.with_name(f".torn{cut.name}"))  # as a run that is killed leaves it
    before = kept.stat().st_mtime_ns
    study.explore(space, tmp_path, {})
    assert asked == [[0, 20, 40], [], [20], []]
    assert kept.stat().st_mtime_ns == before
    assert not list(cut.parent.glob(".*"))
    for name, column in collect(tmp_path).items():
        if name != "seconds":
            np.testing.assert_array_equal(column, whole[name])


@pytest.mark.slow
def test_a_cluster_gives_the_same_though_a_worker_is_killed(tmp_path):
    distributed = pytest.importorskip("distributed")
    space = replace(SPACE, part=10)
    alone = [part_of(space, first, NO_RIVALS) for first in range(0, space.count, space.part)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as cluster:
        victims = [next(iter(cluster.workers.values())).pid]

        def kill(done, whole):
            if done == 1 and victims:
                os.kill(victims.pop(), signal.SIGKILL)

        study.explore(space, tmp_path, {}, cluster.scheduler_address, kill)
    assert not victims
    table = collect(tmp_path)
    for name in MEASURES:
        expected = np.concatenate([part[name] for part in alone])
        np.testing.assert_allclose(table[name], expected, rtol=1e-12)


@pytest.mark.slow
def test_the_command_explores_and_refuses(run_in_process, tmp_path):
    words = ("explore", "layout", "--designs", "128", "--folder", "out", "--no-table")
    status, printed, errors = run_in_process(*words)
    assert status == 0, errors
    assert "128 designs" in printed
    assert "range_roll_mrad follows: radius_mm" in printed
    assert (tmp_path / "out" / "front.png").exists()
    assert not (tmp_path / "out" / "designs.parquet").exists()
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
    why, values, _ = measure_designs(space, some)
    assert (why == 0).sum() > 2
    for n, x in enumerate(some):
        reason, expected = measure_design(space, x)
        assert why[n] == reason
        if reason != 5:
            np.testing.assert_allclose(values[n], expected, rtol=1e-9)


def test_what_is_not_plain_is_looked_at_one_by_one():
    for more in ({"electronics": facets.Electronics()}, {"apertures": facets.Apertures(rim=2.0)}):
        assert not replace(SPACE, sensor=replace(SPACE.sensor, **more)).plain
    for more in ({"rules": replace(CONFIG.range, whole_spot=False)}, {"required": True}):
        assert not replace(SPACE, **more).plain


def test_a_part_of_another_search_is_not_mixed_in(tmp_path):
    """Two processes may find the folder empty; the second to write notices."""
    table = part_of(replace(SPACE, part=4, count=4), 0, NO_RIVALS)
    study.write_part(SPACE, tmp_path, 0, table, {})
    with pytest.raises(OutputError, match="another search"):
        study.write_part(replace(SPACE, seed=2), tmp_path, 60, table, {})
    assert len(study.parts_in(tmp_path)) == 1
