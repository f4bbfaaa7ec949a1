"""Hues stay apart for every kind of eye, and off their ground; sources of the matrices below."""

from itertools import combinations, product

import numpy as np
import pytest

from facets import STATE
from facets.core import ANGLES, DARK, LIGHT, MARKS

#: Machado, Oliveira and Fernandes, IEEE TVCG 15 (2009) 1291, severity 1; in linear sRGB.
EYES = {
    "normal": np.eye(3),
    "protanopia": np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                            [-0.003882, -0.048116, 1.051998]]),
    "deuteranopia": np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                              [-0.011820, 0.042940, 0.968881]]),
    "tritanopia": np.array([[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                            [0.004733, 0.691367, 0.303900]]),
}  # fmt: skip
#: IEC 61966-2-1: linear sRGB to XYZ; and the white of D65.
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                [0.0193339, 0.1191920, 0.9503041]])  # fmt: skip
WHITE = np.array([0.95047, 1.0, 1.08883])
#: Least distance of two hues in CIE Lab. About 2.3 is just seen where two areas touch.
APART = 15.0
#: The same for axes of one unit, which meet in one panel.
TOGETHER = 20.0
#: WCAG 2.1, 1.4.11: what carries information stands 3 to 1 off what lies beside it.
CONTRAST = 3.0
BOTH = pytest.mark.parametrize("hues", [LIGHT, DARK])


def linear(hue):
    code = np.array([int(hue[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def lab(light):
    x = XYZ @ np.clip(light, 0, 1) / WHITE
    f = np.where(x > (6 / 29) ** 3, np.cbrt(x), x / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def distance(one, other, eye):
    first, second = (lab(EYES[eye] @ linear(hue)) for hue in (one, other))
    return float(np.linalg.norm(first - second))


def test_the_simulation_knows_what_is_confused():
    """Red and olive for those without long cones; and what is grey stays as it is for all."""
    red, olive = "#C00000", "#5C5C00"
    assert distance(red, olive, "normal") > 60
    assert distance(red, olive, "protanopia") < APART
    for eye in EYES:
        assert abs(distance("#FFFFFF", "#000000", eye) - 100) < 0.1


@BOTH
def test_detectors_axes_and_series_stay_apart(hues):
    places, angles = ([hues.axes[name] for name in names] for names in (STATE, ANGLES))
    places = [hue for hue in places if hue not in angles]
    for some, least in (
        (hues.detectors.values(), APART),
        (hues.axes.values(), APART),
        (hues.series, APART),
        (places, TOGETHER),
        (angles, TOGETHER),
    ):
        for pair in combinations(some, 2):
            assert min(distance(*pair, eye) for eye in EYES) >= least, pair
    for pair in product(hues.axes.values(), hues.detectors.values()):
        assert distance(*pair, "normal") >= TOGETHER, pair


@BOTH
def test_hues_stand_off_their_ground(hues):
    weight = XYZ[1]
    ground = weight @ linear(hues.ground)
    marks = (*hues.detectors.values(), *hues.axes.values(), *hues.series, hues.grey, hues.alarm)
    for wanted, some in ((CONTRAST, marks), (4.5, (hues.ink, hues.soft))):
        for hue in some:
            low, high = sorted((float(ground), float(weight @ linear(hue))))
            assert (high + 0.05) / (low + 0.05) >= wanted, hue


def test_each_axis_has_its_own_mark():
    assert len(set(MARKS.values())) == len(STATE)
