"""Yield: what is predicted is what is counted, by heads built with and without our code."""

from __future__ import annotations

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from facets.cli.sentences import yields

import facets
from facets import InputError, design, optimize
from facets.design import (
    HeadSettings,
    count_passes,
    draw_heads,
    expand_margins,
    interval,
    predict_yields,
    problem_of,
    robust_layout,
    sensitivities,
    sensor_of,
    simulate_heads,
    states_of,
)

from .conftest import LOOSE

#: Of accuracy: about what half of the heads keep as built, and calibrated.
AS_BUILT = "  accuracy: {tz_um: 14, roll_urad: 60, pitch_urad: 60, yaw_urad: 60}\n"
#: What `calibrate.before` says of the calibration's rig and not of the head.
OF_THE_RIG = {"mount_deg", "lever_mm", "apex_mm", "beam_profile_percent"}
CALIBRATED = "  accuracy: {tz_um: 0.6, roll_urad: 2, pitch_urad: 2, yaw_urad: 2}\n"


def load(folder, text):
    path = folder / "loose.yaml"
    path.write_text(text)
    return facets.load(path)


def assembly(config):
    return HeadSettings(config.layout, config.range, config.calibrate).assembly_of(config.sensor)


def within(share, seen, count):
    """Whether a share is in the interval of what was seen."""
    low, high = interval(seen, count)
    return low <= share <= high


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return load(tmp_path_factory.mktemp("plain"), LOOSE)


@pytest.fixture(scope="module")
def robust(plain):
    """The layout for 90 % of the heads, and the one for perfect heads."""
    layout = replace(plain.layout, production=0.9)
    best = optimize(plain.sensor, layout).best
    problem = problem_of(plain.sensor, layout)
    return robust_layout(problem, HeadSettings(layout, plain.range, plain.calibrate), best), best


def draw_part(part, rng, **sigmas):
    return replace(
        part,
        **{name: getattr(part, name) + rng.normal(0, size) for name, size in sigmas.items()},
    )


def drawn_by_hand(sensor, before, rng):
    """A head drawn about a sensor with nothing of the package but its plain data."""
    place, turn = before["psd_place_mm"], before["psd_turn_mrad"] / 1000
    facet, tilt = before["facet_mrad"] / 1000, before["beam_tilt_mrad"] / 1000
    wide = before["beam_diameter_percent"] / 100
    psds = [
        draw_part(psd, rng, radius=place, height=place, azimuth=place / psd.radius,
                  roll=turn, pitch=turn, yaw=turn)
        for psd in sensor.psds
    ]  # fmt: skip
    sides = [draw_part(side, rng, inclination=facet, azimuth=facet) for side in sensor.facets]
    beam = draw_part(
        sensor.beam, rng, diameter_x=wide * sensor.beam.diameter_x,
        diameter_y=wide * sensor.beam.diameter_y, tilt_x=tilt, tilt_y=tilt,
    )  # fmt: skip
    return replace(sensor, psds=tuple(psds), facets=tuple(sides), beam=beam)


def keeps_all(sensor, layout):
    """Spots, light and limits over the volume, asked by the public functions."""
    states = np.array(states_of(layout, 1.0), dtype=float)
    if not facets.margins(sensor, states)[..., :4].min() > 0:
        return False
    if not facets.readings(sensor, states)[:, 2::3].min() > layout.least_power:
        return False
    free = facets.Knowledge()
    fine = facets.uncertainties(sensor, states, free) * np.array([1e3] * 3 + [1e6] * 3)
    return bool((fine <= layout.limit).all())


def count_by_hand(config, sensor, count):
    rng = np.random.default_rng(5)
    heads = [drawn_by_hand(sensor, config.calibrate.before, rng) for _ in range(count)]
    return sum(keeps_all(head, config.layout) for head in heads)


@pytest.mark.slow
def test_the_predicted_yield_is_that_of_heads_drawn_by_hand(plain):
    built = assembly(plain)
    predicted = predict_yields(expand_margins(built), draw_heads(built)).within_limits
    assert 0.2 < predicted < 0.9, "else the test says nothing"
    assert within(predicted, count_by_hand(plain, plain.sensor, 300), 300)


@pytest.mark.parametrize(
    ("accuracy", "which", "count"), [(AS_BUILT, "built", 120), (CALIBRATED, "calibrated", 60)]
)
@pytest.mark.slow
def test_the_predicted_accuracy_is_that_of_heads_calibrated_from_readings(
    tmp_path, accuracy, which, count
):
    config = load(tmp_path, LOOSE.replace("limit: {tz_um: 2.4,", "limit: {tz_um: 9,") + accuracy)
    config = replace(config, layout=replace(config.layout, calibrated=which == "calibrated"))
    built = assembly(config)
    # spots that leave their detectors are another test's
    small = replace(built.requirement, states=built.requirement.states * 0.8)
    built = replace(built, requirement=small)
    predicted = getattr(predict_yields(expand_margins(built), draw_heads(built)), which)
    heads = simulate_heads(built, count, 3)
    assert heads.unsettled == 0
    assert 0.15 < predicted < 0.95, "else the test says nothing"
    assert within(predicted, count_passes(heads)[which], count)


@pytest.mark.slow
def test_margins_are_no_larger_than_the_yield_needs(robust):
    """With less of them the prediction falls short."""
    found, best = robust
    assert found.result.found
    assert abs(found.within_limits - 0.9) < 0.005
    assert 1.0 < found.factor < 3.0
    assert found.result.objective > best.objective, "margins cost something"


@pytest.mark.slow
def test_a_layout_with_margins_has_the_yield_that_is_asked_for(plain, robust):
    found, best = robust
    perfect, safe = (
        sensor_of(plain.sensor, found.problem.names, x) for x in (best.x, found.result.x)
    )
    assert count_by_hand(plain, perfect, 60) < 0.5 * 60
    assert within(0.9, count_by_hand(plain, safe, 300), 300)


def test_a_yield_over_a_volume_that_is_an_unknown_is_refused(plain, robust):
    layout = replace(plain.layout, aim="range", production=0.9)
    problem = problem_of(plain.sensor, layout)
    with pytest.raises(InputError, match="state the volume"):
        robust_layout(problem, HeadSettings(layout, plain.range, plain.calibrate), robust[1])


def test_of_one_tolerance_alone_the_sensitivity_is_the_yield(tmp_path):
    keys = "psd_place_mm psd_turn_mrad beam_tilt_mrad beam_diameter_percent power_percent"
    rest = ", ".join(f"{key}: null" for key in [*keys.split(), "scale_percent"])
    text = f"extends: layout\ncalibrate: {{before: {{facet_mrad: 0.7, {rest}}}}}\n"
    built = assembly(load(tmp_path, text))
    expansion, draws = expand_margins(built), draw_heads(built)
    (only,) = sensitivities(expansion, draws)
    assert only.key == "facet_mrad"
    assert only.alone.within_limits == predict_yields(expansion, draws).within_limits
    assert only.halved.within_limits > only.alone.within_limits


def test_heads_without_tolerances_are_an_error(plain):
    known = replace(plain.calibrate, before={"mount_deg": 3.0})
    with pytest.raises(InputError, match="no tolerance of the head"):
        HeadSettings(plain.layout, plain.range, known).assembly_of(plain.sensor)


@pytest.mark.slow
def test_the_command_tells_yields_and_writes_tables(run_in_process, tmp_path):
    loose = "bend_um: 0.01, dark_uw: 0.0001, laser_percent: 0.01, psd_place_mm: 0.4"
    text = LOOSE.replace("psd_place_mm: 0.05", loose).replace(
        "before:", "laser: constant\n  before:"
    )
    load(tmp_path, text + CALIBRATED)
    words = ("tolerances", "loose.yaml", "--heads", "10", "-d", "out")
    status, printed, errors = run_in_process(*words)
    assert status == 0, errors
    printed = " ".join(printed.split())
    for part in (
        "and accuracy, calibrated", "% of the heads keep spots, light and limits",
        "most of all for psd_place_mm (spot on PSD", "set optimize.production.yield_percent",
    ):  # fmt: skip
        assert part in printed
    tables = {}
    for name in ("tolerances", "heads"):
        lines = (tmp_path / "out" / f"{name}.csv").read_text().splitlines()
        tables[name] = list(csv.DictReader(line for line in lines if line[0] != "#"))
    before = facets.load(tmp_path / "loose.yaml").calibrate.before
    assert {row["tolerance"] for row in tables["tolerances"]} == {"", *before} - OF_THE_RIG
    assert len(tables["heads"]) == 10
    assert run_in_process(*words)[0] == 2  # without --force


def test_a_perfect_head_that_violates_a_requirement_is_reported_first(run_in_process):
    status, printed, _ = run_in_process("tolerances", "paper", "--heads", "10", "-d", "out")
    printed = " ".join(printed.split())
    assert status == 1
    assert "head itself violates the requirements in the volume (optimize.volume is the" in printed
    assert "The worst margin is -7.39 %: spot on PSD B, -z edge" in printed
    assert "take smaller tolerances" not in printed


@pytest.mark.slow
def test_a_yield_that_can_not_be_had_is_told(run_in_process, tmp_path):
    text = LOOSE.replace("psd_place_mm: 0.05", "psd_place_mm: 3")
    load(tmp_path, text + "  production: {yield_percent: 99}\n")
    status, printed, errors = run_in_process("optimize", "loose.yaml", "-o", "best.yaml")
    assert status == 1, errors
    assert "No layout was found of whose heads 99 %" in printed
    assert not (tmp_path / "best.yaml").exists()


@pytest.mark.parametrize(("laser", "is_said"), [("drifts", True), ("constant", False)])
def test_it_is_said_whether_the_lasers_power_varies(tmp_path, laser, is_said):
    """It does only with calibrate.laser: constant, whatever laser_percent says."""
    text = LOOSE.replace("before: {", f"laser: {laser}\n  before: {{laser_percent: 3, ")
    built = assembly(load(tmp_path, text))
    rows = sensitivities(expand_margins(built), draw_heads(built))
    words = yields.exact_tolerances(SimpleNamespace(by_tolerance=rows))
    assert ("laser_percent (the laser's power)" in words) == is_said
    assert "bend_um" in words


def test_the_starts_of_a_search_show_what_the_objective_stands_for():
    """The worst uncertainty is the root of what is minimised."""
    end = SimpleNamespace(x=[1.0], objective=0.8434, seconds=0.1, status="solve succeeded")
    optimum = SimpleNamespace(names=["radius_mm"], results=[end])
    headings, rows = design.results.tables.start_rows(optimum, "resolution")
    shown = rows[0][headings.index("worst uncertainty")]
    assert float(shown) == pytest.approx(np.sqrt(0.8434), rel=1e-5)
    assert shown[:5] in design.results.tables.objective_text("resolution", 0.8434)
