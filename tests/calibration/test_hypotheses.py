"""Each fault that is tried undoes what its words say: SciPy's rotations and plain columns."""

from __future__ import annotations

import re
from itertools import combinations, permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import facets
from facets.calibration import Data
from facets.calibration.hypotheses import Hypothesis, hypotheses
from facets.detectors import fractions, places

SENSOR = facets.Sensor()
RNG = np.random.default_rng(1)
RAW = RNG.uniform(1, 2, (5, 9))
POSE = RNG.uniform(0.1, 0.3, (5, 6))
TURN = Rotation.from_euler("ZYX", POSE[:, [5, 4, 3]])
NAMES = [f"{kind} of {letter}" for letter in "ABC" for kind in ("psi", "zeta", "power")]
AXES = ("tx", "ty", "tz", "roll", "pitch", "yaw")


def scaled(rows, columns, factor):
    rows = rows.copy()
    rows[:, columns] *= factor
    return rows


def crossed(rows, a, b):
    order = list(range(rows.shape[1]))
    order[a], order[b] = b, a
    return rows[:, order]


def with_angles(turn, order="xyz"):
    """The pose with the angles of a rotation about fixed axes, in some order."""
    columns = [3 + "xyz".index(axis) for axis in order]
    pose = POSE.copy()
    pose[:, columns] = turn.as_euler(order)
    return pose


def columns_of(words):
    """The readings that words name: "psi of all detectors", "psi of A and zeta of B"."""
    kinds = re.findall("psi|zeta|power", words)
    letters = list("ABC") if "all detectors" in words else re.findall(r"\b[ABC]\b", words)
    count = max(len(kinds), len(letters))
    pairs = zip((kinds * 3)[:count], (letters * 3)[:count], strict=True)
    return sorted(NAMES.index(f"{kind} of {letter}") for kind, letter in pairs)


def spoilt_readings():
    """What the readings look like with each fault, by its words and its remedy."""
    faults = {}
    for kind in ("psi", "zeta"):
        for of in ("detector A", "detector B", "detector C", "all detectors"):
            words = f"the sign of {kind} of {of} is swapped"
            faults[words] = scaled(RAW, columns_of(words), -1)
    for order in list(permutations("ABC"))[1:]:
        spoilt = np.empty_like(RAW)  # the columns that are called A, B, C hold those of `order`
        for name, letter in zip("ABC", order, strict=True):
            at, to = (3 * "ABC".index(k) + np.arange(3) for k in (name, letter))
            spoilt[:, to] = RAW[:, at]
        faults[f"name the columns of the readings in the order {''.join(order)}"] = spoilt
    for a, b in combinations(range(9), 2):
        if (a % 3 == 2) == (b % 3 == 2):
            faults[frozenset((a, b))] = crossed(RAW, a, b)
    for unit, factor in (("um where mm is asked for", 1e3), ("m where mm is asked for", 1e-3)):
        columns = [n for n in range(9) if n % 3 < 2]
        faults[f"the spots' places are in {unit}"] = scaled(RAW, columns, factor)
    for unit, factor in (("uW", 1e3), ("W", 1e-3)):
        faults[f"the powers are in {unit} where mW is asked for"] = scaled(RAW, [2, 5, 8], factor)
    for kind, other, words in (
        ("tetra-lateral", "duo-lateral", "a tetra-lateral's and were not straightened"),
        ("duo-lateral", "tetra-lateral", "straightened as a tetra-lateral's and are none"),
    ):
        spoilt = RAW.copy()
        for k, psd in enumerate(SENSOR.psds):
            half, both = np.array([psd.size_y, psd.size_z]) / 2, slice(3 * k, 3 * k + 2)
            currents = fractions(kind, *(RAW[:, both] / half).T, psd.size_z / psd.size_y)
            spoilt[:, both] = places(other, currents, psd.size_z / psd.size_y) * half
        faults[f"the places on the detectors are {words}"] = spoilt
    return faults


def spoilt_poses():
    faults = {}
    for n, axis in enumerate(AXES):
        faults[f"the sign of the reference's {axis} is swapped"] = scaled(POSE, [n], -1)
    for a, b in ((0, 1), (3, 4)):
        faults[f"the reference's {AXES[a]} and {AXES[b]} are exchanged"] = crossed(POSE, a, b)
    for order in ("xzy", "yxz", "yzx", "zxy", "zyx"):
        faults[
            "the reference's angles are taken in another order (about the fixed axes "
            f"{order[0]}, then {order[1]}, then {order[2]}; here x, then y, then z)"
        ] = with_angles(TURN, order)
    faults["the reference gives the inverse rotation"] = with_angles(TURN.inv())
    for degrees in (90, 180, 270):
        words = f"the reference's x and y axes are turned by {degrees} degrees about z"
        seen = Rotation.from_euler("z", -degrees, degrees=True)
        pose = POSE.copy()
        for columns in ([0, 1], [3, 4]):
            vectors = np.column_stack([POSE[:, columns], np.zeros(len(POSE))])
            pose[:, columns] = seen.apply(vectors)[:, :2]
        faults[words] = pose
    angles = {"degrees": np.degrees(1) / 1e3, "rad": 1e-3, "urad": 1e3,
              "arc seconds": 3600 * np.degrees(1) / 1e3}  # fmt: skip
    for unit, factor in angles.items():
        words = f"the reference's angles are in {unit} where mrad is asked for"
        faults[words] = scaled(POSE, [3, 4, 5], factor)
    for unit, factor in (("um", 1e3), ("m", 1e-3)):
        words = f"the reference's lengths are in {unit} where mm is asked for"
        faults[words] = scaled(POSE, [0, 1, 2], factor)
    return faults


def key_of(one: Hypothesis):
    if "in the order" in one.remedy:
        return one.remedy
    if one.remedy == "exchange them" and "reference" not in one.words:
        return frozenset(columns_of(one.words))
    return one.words


def test_every_fault_is_undone():
    """Which also says that no two of them are the same, and that none is left out."""
    raws, poses = spoilt_readings(), spoilt_poses()
    found = {key_of(one): one for one in hypotheses(SENSOR)}
    assert len(found) == len(list(hypotheses(SENSOR)))
    assert set(found) == set(raws) | set(poses)
    for key, one in found.items():
        spoilt = Data(raws.get(key, RAW), poses.get(key, POSE), np.ones(6), np.zeros((5, 2)))
        data = one.change(spoilt)
        assert data.raw == pytest.approx(RAW, rel=1e-9), one.words
        assert data.pose == pytest.approx(POSE, rel=1e-9), one.words
