"""Noise from electronics and the mirror's rim, in the search for a layout."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import facets
from facets import Knowledge, optimize, uncertainties
from facets.design import (
    SKIPPED,
    Space,
    measure_design,
    sensor_of,
    states_of,
)
from facets.detectors import electrode_currents
from facets.model import half_sizes

CONFIG = facets.load("layout")
SCALE = np.array([1e3, 1e3, 1e3, 1e6, 1e6, 1e6])
FREE = Knowledge()
ELECTRONICS = facets.Electronics(bandwidth=5e3, adc_bits=14)


def with_electronics(**more):
    return replace(CONFIG.sensor, electronics=replace(ELECTRONICS, **more))


def fullness(sensor, states):
    """The electrodes' currents (n, 12) at states over 0.95 of the amplifiers' full scale."""
    light = facets.readings(sensor, states).reshape(-1, 3, 3)
    currents = electrode_currents(sensor.electronics, half_sizes(sensor), light).reshape(-1, 12)
    full = sensor.electronics.adc_range / sensor.electronics.transimpedance
    return currents / (0.95 * full)


VOLUME = np.array(states_of(CONFIG.layout, 1.0), dtype=float)


def worst(sensor):
    return float((uncertainties(sensor, VOLUME, FREE) * SCALE / CONFIG.layout.unit).max())


@pytest.mark.parametrize(
    ("electronics", "variables"),
    [({"kind": "duo-lateral", "adc_bits": 10}, {}),  # so coarse that the gain matters
     ({"kind": "pincushion", "adc_bits": 10}, {}),
     ({"ambient": 0.02}, {"size_mm": (9.0, 13.0)})],
)  # fmt: skip
def test_a_gain_is_as_large_as_the_amplifiers_take(electronics, variables):
    sensor = with_electronics(**electronics)
    variables = {"transimpedance_kohm": (5.0, 5000.0)} | variables
    layout = replace(CONFIG.layout, variables=variables, starts=1, head=np.inf)
    best = optimize(sensor, layout).best
    assert best.found
    made = sensor_of(sensor, [*variables], best.x)
    assert fullness(made, VOLUME).max() == pytest.approx(1, rel=1e-5)
    assert "full scale of PSD" in next(k for k in best.active_constraints if "full" in k)
    less = replace(made, electronics=replace(made.electronics, transimpedance=2e4))
    assert worst(made) < worst(less)
    assert np.sqrt(best.objective) == pytest.approx(worst(made), rel=1e-6)


def test_the_light_on_the_mirror_stays_within_its_rim():
    rim = 0.62
    sensor = replace(CONFIG.sensor, apertures=facets.Apertures(rim=rim))
    layout = replace(CONFIG.layout, variables={"diameter_mm": (0.4, 3.0)}, starts=1)
    wide = optimize(CONFIG.sensor, layout).best
    held = optimize(sensor, layout).best
    assert held.found
    assert held.x[0] < wide.x[0] - 0.01
    assert any("rim" in group for group in held.active_constraints)
    out = facets.margins(sensor_of(sensor, ["diameter_mm"], held.x), VOLUME)[:, :, 4]
    assert -1e-6 < out.min() < 0.02


def test_a_drawn_design_past_its_full_scale_is_left_out():
    layout = replace(CONFIG.layout, variables={"transimpedance_kohm": (5.0, 5000.0)})
    space = Space(with_electronics(), CONFIG.range, layout, 8, 1)
    assert measure_design(space, np.array([100.0]))[0] == 0
    why, _ = measure_design(space, np.array([5000.0]))
    assert SKIPPED[why] == "amplifier past its full scale at rest"


def test_the_command_writes_the_gain(run_in_process, tmp_path):
    (tmp_path / "amplified.yaml").write_text(
        "extends: bench\noptimize: {starts: 1, variables: {transimpedance_kohm: [20, 2000], "
        "diameter_mm: [0.5, 1.5]}, volume: {tz_mm: 2, roll_mrad: 4, pitch_mrad: 4}}\n"
    )
    words = ("optimize", "amplified.yaml", "-o", "best.yaml", "--certify", "0", "--plot", "svg")
    status, printed, errors = run_in_process(*words)
    assert status == 0, errors
    assert "electronics.transimpedance_kohm" in printed
    assert "what holds it back" in printed
    assert "not proved: that the readings determine the pose (use --certify)" in printed
    best = facets.load(tmp_path / "best.yaml")
    assert best.sensor.electronics.transimpedance != 2e5
    assert {"best.csv", "best.svg"} <= {path.name for path in tmp_path.iterdir()}
    assert run_in_process(*words)[0] == 2  # without --force
