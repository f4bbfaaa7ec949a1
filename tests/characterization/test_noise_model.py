"""White, flicker, mains and drift that are known are found, each within its interval."""

from __future__ import annotations

import numpy as np
import pytest
from colours import flicker

from facets.characterization import fit_noise, name_of, slope_sigma
from facets.characterization.allan import allan, degrees_of_freedom

RATE, COUNT = 1000.0, 1 << 15
WHITE, FLICKER, MAINS, DRIFT = 2e-3, 0.05, 0.15, 0.01


def signal(seed, white=WHITE, pink=FLICKER, mains=MAINS, drift=DRIFT, count=COUNT):
    rng = np.random.default_rng(seed)
    time = np.arange(count) / RATE
    noise = np.sqrt(white * RATE / 2) * rng.standard_normal(count)
    phase, off = rng.uniform(0, 2 * np.pi), rng.uniform(-0.1, 0.1)
    return (
        5.0 + noise + flicker(rng, pink, count, RATE) + drift * time
        + mains * np.sin(2 * np.pi * (50 + off) * time + phase)
    )  # fmt: skip


@pytest.mark.slow
def test_each_part_is_found_within_its_interval_which_is_no_wider_than_it_must_be():
    """Over 40 signals: 95 % intervals hold the truth in 95 of 100 cases, as chance has it, and the
    spread of what is found is what is said of it."""
    models = [fit_noise(signal(seed), RATE) for seed in range(40)]
    assert {len(model.lines) for model in models} == {1}
    assert {model.spikes for model in models} == {0}
    estimates = {
        "white": ([model.white for model in models], WHITE),
        "flicker": ([model.flicker for model in models], FLICKER),
        "drift": ([model.drift for model in models], DRIFT),
        "mains": ([model.lines[0].amplitude for model in models], MAINS),
    }
    held = {name: [each.holds(true) for each in some] for name, (some, true) in estimates.items()}
    assert min(np.mean(each) for each in held.values()) > 0.82  # at 95 %: less once in 400
    assert np.mean(list(held.values())) > 0.9
    for name in ("white", "flicker", "drift"):
        some = estimates[name][0]
        spread = np.std([each.value for each in some])
        assert 0.6 < spread / np.mean([each.sigma for each in some]) < 1.6, name


def test_white_noise_alone_has_no_flicker_and_no_lines():
    found = fit_noise(signal(1, pink=0.0, mains=0.0, drift=0.0), RATE)
    assert found.flicker.interval[0] < 0.0 < found.flicker.value + found.flicker.sigma
    assert found.lines == ()
    assert found.white_deviation == pytest.approx(1.0, rel=0.02)
    assert found.standard_deviation == pytest.approx(1.0, rel=0.05)


def test_spikes_and_gaps_are_counted_and_do_not_count():
    spoilt = signal(2)
    spoilt[[100, 5_000, 20_000]] += 30.0
    spoilt[10_000:10_040] = np.nan
    found = fit_noise(spoilt, RATE)
    assert found.spikes == 3
    assert found.filled == pytest.approx(40 / COUNT)
    assert found.white.value == pytest.approx(WHITE, rel=0.1)
    assert found.flicker.holds(FLICKER)
    assert found.drift.holds(DRIFT)
    (line,) = found.lines
    assert line.name == "mains, 50 Hz"
    assert line.amplitude.holds(MAINS)


def test_lines_have_names():
    assert name_of(50.1) == "mains, 50 Hz"
    assert name_of(149.8) == "mains, 3 x 50 Hz"
    assert name_of(60.05) == "mains, 60 Hz"
    assert name_of(137.0) == "unknown"


def test_the_slope_of_white_noise_is_as_well_known_as_the_textbook_says():
    time = np.arange(1000) / RATE
    centred = time - time.mean()
    assert slope_sigma(time, RATE, 2 / RATE, 0.0) == pytest.approx(
        1 / np.sqrt(centred @ centred), rel=1e-3
    )


def test_too_few_samples_are_refused():
    with pytest.raises(ValueError, match="too few"):
        fit_noise(np.full(100, np.nan), RATE)


def test_allan_deviations_are_those_of_another_program():
    allantools = pytest.importorskip("allantools")
    values = signal(3, count=4096)
    found = allan(values, RATE)
    tau, deviation, _, _ = allantools.oadev(
        values, rate=RATE, data_type="freq", taus=found.tau[found.tau < 1.0]
    )
    np.testing.assert_allclose(found.tau[: len(tau)], tau, rtol=1e-9)
    np.testing.assert_allclose(found.deviation[: len(tau)], deviation, rtol=1e-9)
    for alpha, slope in ((0, -0.5), (-1, 0.0), (-2, 0.5)):
        for m in (1, 4, 32)[alpha == -1 :]:  # where m is 1, the other program forgets a square
            assert degrees_of_freedom(4097, m, slope) == pytest.approx(
                allantools.edf_simple(4097, m, alpha), rel=1e-6
            )


def test_allan_deviations_of_white_noise_hold_the_truth_also_with_gaps():
    rng = np.random.default_rng(4)
    held = []
    for _ in range(40):
        values = rng.standard_normal(4000)
        values[1000:1100] = np.nan
        values[rng.integers(0, 4000, 5)] = np.nan
        found = allan(values, 1.0)
        some = (found.tau >= 4) & (found.tau <= 60)
        true = 1 / np.sqrt(found.tau[some])
        held.append((found.low[some] < true) & (true < found.high[some]))
    assert 0.88 < np.mean(held) <= 1.0
