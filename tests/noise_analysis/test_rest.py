"""A mirror at rest is told from one that is not, on signals from outside any model of noise.

Eight thousand samples at 1 kHz, with white noise that is known; what is added is known as well.
"""

import numpy as np
import pytest
from colours import flicker
from scipy.signal import lfilter

import facets
from facets import STATE
from facets.core import READING_COLUMNS
from facets.detectors import SATURATED
from facets.noise_analysis import find_faults, fit_noise, longest_section, reading_faults

COUNT, RATE = 8_000, 1_000.0
CONFIG = facets.load("paper")
SIGMA = np.tile([3e-4, 3e-4, 2e-5], 3)  # mm, mm, mW
TIME = np.arange(COUNT) / RATE
RISE = np.linspace(0, 1, COUNT)
REST = facets.readings(CONFIG.sensor, np.zeros(8))
JACOBIAN = facets.jacobian(CONFIG.sensor, np.zeros(8))


def noise():
    return REST + SIGMA * np.random.default_rng(1).standard_normal((COUNT, 9))


def change(what, course):
    """Readings' change by a motion of an axis, or of one reading, in standard deviations."""
    if what in READING_COLUMNS:
        return np.outer(SIGMA[0] * course, np.array(READING_COLUMNS) == what)
    k = STATE.index(what)
    state = np.outer(course / np.abs(JACOBIAN[:, k] / SIGMA).max(), np.eye(8)[k])
    return facets.readings(CONFIG.sensor, state) - REST


def table(readings, flags=0):
    columns = {name: readings[:, n] for n, name in enumerate(READING_COLUMNS)}
    number = np.arange(len(readings))
    return columns | {
        "seq": number,
        "board_us": 1000 * number,
        "flags": np.full(len(readings), flags, np.uint8),
    }


def faults(readings, flags=0):
    columns = table(readings, flags)
    found = reading_faults(columns, CONFIG)
    if found:
        return found
    piece = longest_section(columns, "it")
    models = [fit_noise(1e3 * piece.resample(columns[name]), RATE) for name in READING_COLUMNS]
    return find_faults(columns, piece, models, CONFIG)


def swing(frequency):
    return np.sin(2 * np.pi * frequency * TIME)


STEP = TIME > 3.2
BURST = np.where((TIME > 2) & (TIME < 2.04), 30.0, 0.0)
WALK = np.cumsum(np.random.default_rng(3).standard_normal(COUNT)) / COUNT**0.5


@pytest.mark.parametrize(
    ("what", "course", "words"),
    [
        ("yaw", 10 * RISE, ["drifts by", "when the mirror moves, mostly in yaw"]),
        ("tz", 2 * swing(0.375), ["zeta on detector A wanders", "mostly in tz"]),
        ("pitch", 1.2 * swing(5), ["move together", "the mirror or the beam moves or vibrates"]),
        ("tx", 5 * swing(33), ["The shares of light on the detectors move together"]),
        ("tx", 5 * STEP, ["jumps after 3.25 s", "when the beam moves", "or as when the mirror"]),
        ("ty", 8 * WALK, ["The share of light on detector", "wanders by"]),
        ("zeta_b_mm", 8 * WALK, ["Only detector B changes, so it is not the mirror"]),
        ("zeta_b_mm", BURST, ["zeta on detector B scatters"]),
        ("zeta_b_mm", 8 * swing(50.02), ["swings with the mains by 2.41 µm (amplitude)"]),
    ],
)
def test_what_is_not_noise_is_found_and_named(what, course, words):
    found = " ".join(faults(noise() + change(what, course)))
    assert all(word in found for word in words)
    assert what in STATE or "mirror moves" not in found


def test_a_common_motion_is_as_large_as_it_was_made():
    """Twice the noise in yaw, from sample to sample, is 2 / sqrt(5) of what is seen, to 10 %."""
    random = np.random.default_rng(4).standard_normal(COUNT)
    (sentence,) = faults(noise() + change("yaw", 2 * random))
    assert "The spots move together within 0.001 s" in sentence
    amount = float(sentence.partition(" by ")[2].partition(" times ")[0])
    assert amount == pytest.approx(2 / 5**0.5, rel=0.1)


def test_the_longest_of_several_sections_is_taken():
    columns = table(noise())
    for first in (1500, 6000):
        columns["board_us"] += 10**6 * (np.arange(COUNT) >= first)
    piece = longest_section(columns, "it")
    assert (piece.rows.start, piece.rows.stop) == (1500, 6000)
    assert piece.rate == pytest.approx(RATE)


def with_flicker(corner):
    """Noise with as much flicker of its own on each reading as makes that corner, Hz."""
    rng = np.random.default_rng(6)
    added = [flicker(rng, s**2 / (RATE / 2) * corner, COUNT, RATE) for s in SIGMA]
    return noise() + np.transpose(added)


#: Share that a low pass of 100 Hz keeps of what was before.
KEPT = np.exp(-2 * np.pi * 0.1)
#: What honest electronics, a laser and a mirror at rest make.
HONEST = {
    "low pass": REST + lfilter([1 - KEPT], [1, -KEPT], noise() - REST, axis=0),
    "1/f": with_flicker(100),
    "nothing but 1/f": with_flicker(50_000),
    "hum": noise() + 0.8 * SIGMA * swing(49.97)[:, None],
    "small drift": noise() + change("psi_a_mm", 3 * RISE),
    "laser": noise() * (1 + 0.02 * np.outer(RISE, [0, 0, 1] * 3)),
    "spikes": noise() + 50 * SIGMA * (np.arange(COUNT)[:, None] % 1999 == 1000),
    "bits": np.round(noise() / SIGMA) * SIGMA,
    "short": noise()[:70],
}


@pytest.mark.parametrize("name", HONEST)
def test_a_mirror_at_rest_with_honest_electronics_is_at_rest(name):
    assert faults(HONEST[name]) == []


def test_lost_light_saturation_and_coarse_converters_are_told():
    dark, full, coarse, weak = noise(), noise(), noise(), noise()
    dark[1000:, 3:5], dark[1000:, 5] = np.nan, 1e-9
    full[:80, 6:] = np.nan
    coarse[:, 1] = np.round(coarse[:, 1] / (5 * SIGMA[1])) * 5 * SIGMA[1]
    weak[STEP, 2::3] *= 0.9
    for readings, words in (
        (dark, "Detector B is without light in 87.5 % of the samples (allowed: 0.1 %)."),
        (full, "Detector C is saturated in 1 % of the samples (allowed: 0.1 %)."),
        (coarse, "successive values of zeta_a_mm are equal"),
        (weak, "The power on all detectors together changes by 10."),
    ):
        flags = np.where(np.isnan(readings[:, 6]), SATURATED, 0)
        assert words in " ".join(faults(readings, flags))
