"""Design spaces: the same parts anywhere, gone on with after a cut, and the front that is one."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from dataclasses import replace

import numpy as np
import pytest
from commands import PROGRAM, command

import facets
from facets import InputError, OutputError, axis_ranges, pictures
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
    dim = replace(SPACE, layout=replace(SPACE.layout, least_power=0.2))
    why, values = measure_design(dim, OWN)
    assert SKIPPED[why] == "too little light at rest"
    assert np.isnan(values[1:]).all()
    rules = CONFIG.range
    coarse = replace(rules, coarsest=(1e-9,) * 6)
    for broken, words in ((coarse, "too coarse at rest"), (replace(rules, snr=1e9), "too little")):
        why, values = measure_design(replace(SPACE, rules=broken), OWN)
        assert SKIPPED[why].startswith(words)
        assert np.isnan(values[study.AT_RANGES]).all()
        assert np.isfinite(values[MEASURES.index("condition")])


def test_too_few_designs_make_no_picture():
    names = ["head_mm", "u_tz_um"]
    for count in (0, 1, 2):
        table = {name: np.array([np.nan, 1.0, 2.0])[: count + 1] for name in names}
        best = study.front(table, names)
        picture = pictures.exploration.front_picture(table, best, names, {})
        assert (picture is None) == (count < 2)


def brute(costs):
    """By the definition: no other is as good in all and better in one."""
    return np.array(
        [not any((c <= mine).all() and (c < mine).any() for c in costs) for mine in costs]
    )


def test_the_front_is_that_of_the_definition():
    rng = np.random.default_rng(1)
    table = {name: rng.random(300) for name in MEASURES}
    table["u_tz_um"][:5] = np.nan
    names = ["head_mm", "u_tz_um", "range_yaw_mrad"]
    best = study.front(table, names)
    costs = np.stack([table["head_mm"], table["u_tz_um"], -table["range_yaw_mrad"]], axis=1)
    assert not best[:5].any()
    np.testing.assert_array_equal(best[5:], brute(costs[5:]))


#: Of a plain sensor no design is skipped: this one has electronics.
PILOTED = replace(
    SPACE, sensor=replace(SPACE.sensor, electronics=facets.Electronics()), part=100, count=600
)


@pytest.mark.slow
def test_what_is_skipped_is_not_on_the_front():
    """After 500 designs, of which nothing is skipped, 100 follow: the front without skipping has
    the same designs, and the skipped are a good part of all."""
    pilot = [part_of(PILOTED, first, NO_RIVALS) for first in range(0, 500, 100)]
    full = part_of(replace(PILOTED, every=True), 500, NO_RIVALS)
    table = {name: np.concatenate([part[name] for part in pilot]) for name in MEASURES}
    best = study.front(table, list(SPACE.objectives))
    rivals = np.stack([column[best] for column in table.values()], axis=1)
    for objectives in (
        ("head_mm", "u_roll_urad", "range_roll_mrad"),
        ("range_tz_mm", "range_yaw_mrad"),
        ("u_tz_um", "condition"),
    ):
        short = part_of(replace(PILOTED, objectives=objectives), 500, rivals)
        assert (short["skipped"] == SKIPPED[5]).sum() > 20
        fronts = []
        for last in (full, short):
            table = {name: np.concatenate([t[name] for t in [*pilot, last]]) for name in full}
            fronts.append(table["design"][study.front(table, list(objectives))])
        np.testing.assert_array_equal(*fronts)


def test_only_what_keeps_the_requirement_is_looked_at():
    space = replace(SPACE, required=True)
    best = np.array([221.0, 53.0, 257.0, 119.75, 1.8])
    assert measure_design(space, best)[0] == 0
    assert meets(space.sensor, space.layout, space.volume)  # the paper's own
    fine = replace(space.layout, limit=(*[np.inf] * 2, 0.1, *[np.inf] * 3))
    assert not meets(space.sensor, fine, space.volume)
    why, _ = measure_design(replace(space, layout=fine), best)
    assert SKIPPED[why] == "not what is required over the volume"


def test_a_singular_design_is_told():
    for name, regular in (("paper", 1.0), ("singular", 0.0)):
        sensor = facets.load(name).sensor
        volume = (0.0, 0.0, 3.0, 0.02, 0.02, 0.02, 0.0, 0.0)
        layout = replace(CONFIG.layout, variables={"power_mw": (0.2, 0.4)}, volume=volume)
        space = Space(sensor, CONFIG.range, layout, "sobol", 4, 1)
        _, values = measure_design(space, np.array([0.3]))
        assert values[MEASURES.index("regular")] == regular


def test_a_run_goes_on_where_it_was_cut_off(tmp_path, monkeypatch):
    asked = []

    def here(space, firsts, rivals, _):
        asked.append(list(firsts))
        for first in firsts:
            yield first, part_of(space, first, rivals)

    monkeypatch.setattr(study, "run_in_processes", here)
    space = replace(SPACE, part=20)
    study.explore(space, tmp_path, {})
    whole = collect(tmp_path)
    (tmp_path / "parts" / "0000000020.parquet").unlink()
    study.explore(space, tmp_path, {})
    assert asked == [[0, 20, 40], [], [20], []]
    for name, column in collect(tmp_path).items():
        if name != "seconds":
            np.testing.assert_array_equal(column, whole[name])


@pytest.mark.slow
def test_a_cluster_gives_the_same_though_a_worker_is_killed(tmp_path):
    distributed = pytest.importorskip("distributed")
    space = replace(SPACE, part=10, count=100)
    alone = [part_of(space, first, NO_RIVALS) for first in range(0, 100, 10)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
    ) as cluster:
        victim = next(iter(cluster.workers.values())).pid
        killed = []

        def tell(done, whole):
            if done == 1 and not killed:
                killed.append(victim)
                os.kill(victim, signal.SIGKILL)

        words = study.cluster_words(cluster.scheduler_address)
        assert words.startswith("2 workers at tcp://")
        assert "dashboard http://127.0.0.1:" in words
        study.explore(space, tmp_path, {}, cluster.scheduler_address, tell)
    assert killed
    found = collect(tmp_path)
    for name in MEASURES:
        expected = np.concatenate([part[name] for part in alone])
        np.testing.assert_allclose(found[name], expected, rtol=1e-12)


@pytest.mark.slow
def test_the_command_explores_and_refuses(tmp_path):
    arguments = ("explore", "layout", "--designs", "128", "--folder", "out")
    result = command(*arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "128 designs" in result.stdout
    assert "range_roll_mrad follows: radius_mm" in result.stdout
    assert (tmp_path / "out" / "front.png").stat().st_size > 10_000
    for words, message in (
        ((*arguments[:-2], "--seed", "2", "-d", "out"), "another search"),
        (("explore", "layout", "--objective", "cost", "-d", "new"), "unknown measure cost"),
        (("explore", "layout", "--scheduler", "tcp://127.0.0.1:1", "-d", "new"), "no cluster"),
        (("explore", "layout", "--report", "page.txt", "-d", "new"), ".html"),
    ):
        result = command(*words, cwd=tmp_path)
        assert result.returncode == 2
        assert message in result.stderr


def vary(**variables):
    return {"layout": replace(CONFIG.layout, variables=variables)}


@pytest.mark.parametrize(
    "more",
    [
        {"rules": replace(CONFIG.range, tracking=True)},
        vary(size_mm=(2.0, 20.0), diameter_mm=(0.2, 4.0)),
        {"sensor": facets.load("skewed").sensor},
        vary(facet_b_azimuth_deg=(119.0, 121.0), inclination_deg=(44.7, 45.3),
             psd_a_height_mm=(-6.0, 6.0)),
    ],
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
    assert not replace(SPACE, rules=replace(CONFIG.range, whole_spot=False)).plain
    assert not replace(SPACE, required=True).plain


@pytest.mark.slow
def test_a_run_killed_outright_goes_on_and_makes_nothing_twice(tmp_path):
    words = ("explore", "layout", "--designs", "1000", "--folder", "out", "--no-table")
    folder = tmp_path / "out"
    process = subprocess.Popen([*PROGRAM, *words], cwd=tmp_path, stdout=subprocess.DEVNULL)
    while process.poll() is None and not study.parts_in(folder):
        time.sleep(0.01)
    process.kill()
    process.wait()
    kept = {path: path.stat().st_mtime_ns for path in study.parts_in(folder)}
    assert 1 <= len(kept) < 5
    result = command(*words, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    np.testing.assert_array_equal(np.sort(collect(folder)["design"]), np.arange(1000))
    assert not (folder / "designs.parquet").exists()


def test_an_older_page_is_not_replaced_unasked(run_in_process, tmp_path):
    (tmp_path / "page.html").write_text("mine")
    words = ("explore", "layout", "--report", "page.html", "--folder", "out")
    status, _, errors = run_in_process(*words)
    assert status == 2
    assert "page.html" in errors
    assert (tmp_path / "page.html").read_text() == "mine"
    assert not (tmp_path / "out").exists()


def test_nothing_to_vary_is_an_error():
    with pytest.raises(InputError, match="name what may vary"):
        designs(replace(SPACE, layout=replace(SPACE.layout, variables={})))


def test_a_part_of_another_search_is_not_mixed_in(tmp_path):
    """Two processes may find the folder empty; the second to write notices."""
    table = part_of(replace(SPACE, part=4, count=4), 0, NO_RIVALS)
    study.write_part(SPACE, tmp_path, 0, table, {})
    with pytest.raises(OutputError, match="another search"):
        study.write_part(replace(SPACE, seed=2), tmp_path, 60, table, {})
    assert len(study.parts_in(tmp_path)) == 1
