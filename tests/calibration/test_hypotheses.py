"""Each fault that is tried undoes what its words say: SciPy's rotations and plain columns."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import facets
from facets.calibration import Data, Moves, faults
from facets.detectors import fractions, places

SENSOR = facets.Sensor()
RNG = np.random.default_rng(1)
RAW = RNG.uniform(1, 2, (5, 9))
POSE = RNG.uniform(0.1, 0.3, (5, 6))
TURN = Rotation.from_euler("ZYX", POSE[:, [5, 4, 3]])
NAMES = [f"{kind} of {letter}" for letter in "ABC" for kind in ("psi", "zeta", "power")]
AXES = ("tx", "ty", "tz", "roll", "pitch", "yaw")


def scale(rows, columns, factor):
    rows = rows.copy()
    rows[:, columns] *= factor
    return rows


def exchange(rows, a, b):
    order = np.arange(rows.shape[1])
    order[[a, b]] = b, a
    return rows[:, order]


def replace_angles(turn, order="xyz"):
    """The pose with the angles of a rotation about fixed axes, in some order."""
    pose = POSE.copy()
    pose[:, [3 + "xyz".index(axis) for axis in order]] = turn.as_euler(order)
    return pose


def columns_of(words):
    """The readings that words name: "psi of all detectors", "psi of A and zeta of B"."""
    kinds = re.findall("psi|zeta|power", words)
    letters = list("ABC") if "all detectors" in words else re.findall(r"\b[ABC]\b", words)
    count = max(len(kinds), len(letters))
    pairs = zip((kinds * 3)[:count], (letters * 3)[:count], strict=True)
    return [NAMES.index(f"{kind} of {letter}") for kind, letter in pairs]


def spoil_readings(fault):
    """What the readings look like with a fault."""
    words, remedy = fault.words, fault.remedy
    if "sign" in words:
        return scale(RAW, columns_of(words), -1)
    if "in the order" in remedy:
        order = ["ABC".index(letter) for letter in remedy.split()[-1]]
        return RAW.reshape(5, 3, 3)[:, np.argsort(order)].reshape(5, 9)
    if "exchanged" in words:
        return exchange(RAW, *columns_of(words))
    if "places are" in words:
        return scale(RAW, [0, 1, 3, 4, 6, 7], 1e3 if "in um" in words else 1e-3)
    if "powers are" in words:
        return scale(RAW, [2, 5, 8], 1e3 if "in uW" in words else 1e-3)
    kinds = ["tetra-lateral", "duo-lateral"]
    kind, other = kinds if "were not straightened" in words else kinds[::-1]
    spoilt = RAW.copy()
    for k in range(3):
        both = slice(3 * k, 3 * k + 2)
        spoilt[:, both] = 6.5 * places(other, fractions(kind, *(RAW[:, both].T / 6.5)))
    return spoilt


def spoilt_poses():
    faults = {"the reference gives the inverse rotation": replace_angles(TURN.inv())}
    for n, axis in enumerate(AXES):
        faults[f"the sign of the reference's {axis} is swapped"] = scale(POSE, [n], -1)
    for a, b in ((0, 1), (3, 4)):
        faults[f"the reference's {AXES[a]} and {AXES[b]} are exchanged"] = exchange(POSE, a, b)
    for order in ("xzy", "yxz", "yzx", "zxy", "zyx"):
        faults[
            "the reference's angles are taken in another order (about the fixed axes "
            f"{order[0]}, then {order[1]}, then {order[2]}; here x, then y, then z)"
        ] = replace_angles(TURN, order)
    for degrees in (90, 180, 270):
        axes = Rotation.from_euler("z", -degrees, degrees=True).as_matrix()[:2, :2].T
        pose = POSE.copy()
        pose[:, :2], pose[:, 3:5] = POSE[:, :2] @ axes, POSE[:, 3:5] @ axes
        faults[f"the reference's x and y axes are turned by {degrees} degrees about z"] = pose
    for quantity, columns, units in (
        ("angles", slice(3, 6), {"degrees": np.degrees(1) / 1e3, "rad": 1e-3, "urad": 1e3,
                                 "arc minutes": 0.06 * np.degrees(1),
                                 "arc seconds": 3.6 * np.degrees(1)}),
        ("lengths", slice(0, 3), {"um": 1e3, "m": 1e-3}),
    ):  # fmt: skip
        usual = {"angles": "mrad", "lengths": "mm"}[quantity]
        for unit, factor in units.items():
            words = f"the reference's {quantity} are in {unit} where {usual} is asked for"
            faults[words] = scale(POSE, columns, factor)
    return faults


def test_every_fault_is_undone():
    """Which also says that no two of them are the same, and that none is left out."""
    poses = spoilt_poses()
    tried = list(faults.table_faults(SENSOR))
    assert len({(fault.words, fault.remedy) for fault in tried}) == len(tried) == 63
    for fault in tried:
        if "rows are" in fault.words:
            below = "below" in fault.words
            pose = np.roll(POSE, 1 if below else -1, axis=0)
            step = np.diff(pose, axis=0, prepend=pose[:1])
            spoilt = Data(RAW, pose, np.ones(6), np.zeros((5, 2)), moves=Moves(
                step, step, RAW, np.roll(step, -1, axis=0), step))  # fmt: skip
            rows = slice(0, -1) if below else slice(1, None)  # the last, or first, has no other
            assert fault.change(spoilt).pose[rows] == pytest.approx(POSE[rows])
            continue
        if "reference" in fault.words:
            raw, pose = RAW, poses.pop(fault.words)
        else:
            raw, pose = spoil_readings(fault), POSE
        data = fault.change(Data(raw, pose, np.ones(6), np.zeros((5, 2))))
        assert data.raw == pytest.approx(RAW, rel=1e-9), fault.words
        assert data.pose == pytest.approx(POSE, rel=1e-9), fault.words
    assert not poses
