"""White, flicker, mains and drift that are known are found, each within its interval."""

import numpy as np
import pytest
from colours import flicker

from facets.noise_analysis import fit_noise

RATE, COUNT = 1000.0, 1 << 15
TRUE = WHITE, FLICKER, DRIFT, MAINS = 2e-3, 0.05, 0.01, 0.15


def signal(seed, pink=FLICKER, mains=MAINS, drift=DRIFT):
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) / RATE
    noise = np.sqrt(WHITE * RATE / 2) * rng.standard_normal(COUNT)
    phase, off = rng.uniform(0, 2 * np.pi), rng.uniform(-0.1, 0.1)
    wave = mains * np.sin(2 * np.pi * (50 + off) * time + phase)
    return 5.0 + noise + flicker(rng, pink, COUNT, RATE) + drift * time + wave


def estimates(model):
    """White, flicker, drift and the one line of a model."""
    (line,) = model.lines
    return [model.white, model.flicker, model.drift, line.amplitude]


def holds(estimate, true):
    low, high = estimate.interval
    return low <= true <= high


@pytest.mark.slow
def test_each_part_is_found_within_its_interval_which_is_no_wider_than_it_must_be():
    """Over 40 signals: 95 % intervals hold the truth in 95 of 100 cases, as chance has it, and the
    spread of what is found is what is said of it."""
    models = [fit_noise(signal(seed), RATE) for seed in range(40)]
    assert {model.spikes for model in models} == {0}
    shares = []
    parts = zip(*map(estimates, models), strict=True)
    for part, true in zip(parts, TRUE, strict=True):
        shares.append(np.mean([holds(each, true) for each in part]))
        spread = np.std([each.value for each in part])
        assert 0.6 < spread / np.mean([each.sigma for each in part]) < 1.6
    assert min(shares) > 0.82  # at 95 %: less once in 400
    assert np.mean(shares) > 0.9


def test_white_noise_alone_has_no_flicker_and_no_lines():
    model = fit_noise(signal(1, pink=0.0, mains=0.0, drift=0.0), RATE)
    assert model.flicker.interval[0] < 0.0 < model.flicker.value + model.flicker.sigma
    assert model.lines == ()
    assert model.white_deviation == pytest.approx(1.0, rel=0.02)
    assert model.standard_deviation == pytest.approx(1.0, rel=0.05)
    textbook = model.white_deviation * RATE * np.sqrt(12 / COUNT**3)
    assert model.drift.sigma == pytest.approx(textbook, rel=1e-3)
    with pytest.raises(ValueError, match="too few"):
        fit_noise(np.full(100, np.nan), RATE)


def test_spikes_and_gaps_are_counted_and_do_not_count():
    spoilt = signal(2)
    spoilt[[100, 5_000, 20_000]] += 30.0
    spoilt[10_000:10_040] = np.nan
    model = fit_noise(spoilt, RATE)
    assert model.spikes == 3
    assert model.filled == pytest.approx(40 / COUNT)
    assert all(holds(each, true) for each, true in zip(estimates(model), TRUE, strict=True))
    assert model.white.sigma < 0.1 * WHITE
