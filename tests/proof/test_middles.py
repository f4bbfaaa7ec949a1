"""Near the singular sensor the hull of all Jacobians is not regular, but the middles' are."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
from facets.experiments import certificate_schema, check_certificate
from flint import arb

import facets
from facets.characterization import box_of_poses
from facets.model import parameters, sensor_with
from facets.proof import certify, edges_over_rotations, middles, write_certificate
from facets.proof.light_sharing import bounds_at_fixed_shares, hull_of_bounds
from facets.proof.reach import find_core
from facets.proof.slopes import Sloped
from facets.proof.spot_jacobian import centred_jacobian, interval_geometry, spot_jacobian
from facets.scalars import intervals

HALF = np.array([5, 5, 5, 0.012, 0.012, 0.02])
SHARE = 0.15


def on_the_way(part):
    """A sensor between the paper's and the singular one."""
    first, last = (np.array(parameters(facets.load(n).sensor)) for n in ("paper", "singular"))
    return sensor_with(facets.load("paper").sensor, (first + part * (last - first)).tolist())


def light_of(sensor):
    ball = interval_geometry(sensor)
    parts = edges_over_rotations(ball, box_of_poses(-HALF, HALF))
    return ball, hull_of_bounds([bounds_at_fixed_shares(edges, SHARE) for edges in parts])


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    path = tmp_path_factory.mktemp("middles") / "certificate.json"
    sensor = on_the_way(0.85)
    found = certify(sensor, box_of_poses(-HALF, HALF), SHARE)
    assert found.unique
    assert found.regular
    assert found.at_least > 0
    assert found.middles is not None
    write_certificate(path, sensor, found, {"config": "on the way"})
    return path


@pytest.mark.slow
def test_it_is_checked_again(certificate):
    found = check_certificate.check(certificate)
    assert 0.1 < found.margin < 1
    assert found.determinant > 0


def test_the_bound_of_its_determinant_holds(certificate):
    sensor, rng = on_the_way(0.85), np.random.default_rng(1)
    pose = rng.uniform(-HALF, HALF, (3000, 6))
    states = np.concatenate([pose, pose[:, :2] - rng.uniform(-0.3, 0.3, (3000, 2))], axis=1)
    lit = facets.readings(sensor, states)[:, 2::3].min(axis=1) >= SHARE * sensor.beam.power
    matrices = facets.jacobian(sensor, states[lit])
    least = np.abs(np.linalg.det(np.delete(matrices, 8, axis=1))).min()
    assert json.loads(certificate.read_text())["least_determinant"] <= least


def another_sensor(content):
    content["parameters"] = list(parameters(facets.load("singular").sensor))


def forget(content):
    content["middles"] = None


def larger_box(content):
    for end in ("low", "high"):
        content[end] = [2 * x for x in content[end]]
        for piece in content["pieces"]:
            piece[end] = [2 * x for x in piece[end]]


def put(*where):
    *keys, name, value = where

    def spoil(content):
        for key in keys:
            content = content[key]
        content[name] = value

    return spoil


SPOILS = {
    "the singular sensor": (another_sensor, "light|singular|hull"),
    "without the affine part": (forget, "least piece|singular"),
    "a box twice as large": (larger_box, "light|singular"),
    "slopes of zero": (put("middles", "slopes", [[[0.0] * 6] * 6] * 6), "singular"),
    "a value of infinity": (put("middles", "value", 0, 0, float("inf")), "no number"),
    "a value too large": (put("middles", "value", 0, 0, 1e301), "too large"),
    "five slopes": (put("middles", "slopes", [[[0.0] * 6] * 6] * 5), "5 entries"),
    "a key too many": (put("middles", "rest", 0.0), "nothing is known"),
    "a list": (put("middles", []), "needed: object or null"),
    "a larger determinant": (put("pieces", 0, "at_least", 1e12), "larger"),
}


@pytest.mark.parametrize("name", SPOILS)
@pytest.mark.slow
def test_what_is_spoilt_is_refused_with_a_reason(certificate, tmp_path, name, monkeypatch):
    from facets.experiments import certificate_pieces

    monkeypatch.setattr(certificate_pieces, "MOST", 100)
    spoil, reason = SPOILS[name]
    content = json.loads(certificate.read_text())
    spoil(content)
    path = tmp_path / "spoilt.json"
    path.write_text(json.dumps(content))
    with pytest.raises(certificate_schema.Refused, match=reason):
        check_certificate.check(path)


@pytest.mark.slow
def test_a_determinant_that_is_claimed_too_large_is_not_told(certificate, tmp_path):
    content = copy.deepcopy(json.loads(certificate.read_text()))
    content["least_determinant"] = 1e20
    path = tmp_path / "spoilt.json"
    path.write_text(json.dumps(content))
    with pytest.raises(certificate_schema.Refused, match="larger determinant"):
        check_certificate.check(path)


@pytest.mark.slow
def test_nothing_is_proved_past_the_singular_sensor():
    found = certify(on_the_way(1.0), box_of_poses(-HALF, HALF), SHARE, work=150)
    assert not found.unique


def test_jacobians_of_a_piece_lie_in_what_its_slopes_make_of_the_middle():
    ball, light = light_of(on_the_way(0.5))
    low, high = np.array([1, -2, 0, 0.001, -0.004, 0]), np.array([2, 1, 4, 0.005, 0.004, 0.009])
    found = centred_jacobian(ball, light, low, high)
    whole = found.whole()
    rng = np.random.default_rng(2)
    for _ in range(30):
        pose = [arb(float(x)) for x in low + rng.integers(0, 3, 6) / 2 * (high - low)]
        single = spot_jacobian(ball, light, pose)
        for i in range(6):
            for j in range(6):
                inner, outer = intervals.ends(single[i][j]), intervals.ends(whole[i][j])
                assert outer[0] <= inner[0] + 1e-9 * abs(inner[0])
                assert outer[1] >= inner[1] - 1e-9 * abs(inner[1])


def test_slopes_are_those_of_differences():
    ball, light = light_of(on_the_way(0.5))
    light = light._replace(
        from_point=[[x.mid() for x in row] for row in light.from_point],
        turns=[[[x.mid() for x in row] for row in rows] for rows in light.turns],
    )
    pose, step = np.array([1, -2, 3, 0.004, -0.003, 0.01]), 1e-5
    found = centred_jacobian(ball, light, pose, pose)

    def values(place):
        rows = spot_jacobian(ball, light, [arb(float(x)) for x in place])
        return np.array([[float(x.mid()) for x in row] for row in rows])

    for axis in range(6):
        way = step * np.eye(6)[axis]
        slope = (values(pose + way) - values(pose - way)) / (2 * step)
        np.testing.assert_allclose(
            [[float(x.mid()) for x in row] for row in found.slopes[axis]], slope, atol=2e-4
        )


def test_the_affine_part_may_be_anything():
    """It proves the less the further it is off, and nothing that is not so."""
    sensor, box = on_the_way(0.5), box_of_poses(-HALF / 2, HALF / 2)
    ball, light = light_of(sensor)
    over = centred_jacobian(ball, light, -HALF / 2, HALF / 2)
    affine = middles.affine_part(ball, light, box)
    off = affine._replace(slopes=-affine.slopes)
    sizes = []
    for part in (affine, off):
        rest = middles.affine_remainder(part, over)
        whole = middles.add_matrices(
            part.evaluate([intervals.interval(-x, x) for x in HALF / 2]), rest
        )
        sizes.append(sum(float(x.rad()) for row in rest for x in row))
        for row, exact in zip(whole, over.middle, strict=True):
            assert all(x.contains(y) for x, y in zip(row, exact, strict=True))
    assert sizes[0] < sizes[1]


def test_numbers_with_slopes():
    x = Sloped(arb(2), (arb(1), arb(0), arb(3)))
    found = (1 - 1 / (x * x)) / (x.sqrt() + 2) - x
    value = (1 - 1 / 4) / (2**0.5 + 2) - 2
    assert float(found.value) == pytest.approx(value)
    root = 2**0.5
    rate = (2 / 8) / (root + 2) - 0.75 / (2 * root) / (root + 2) ** 2 - 1
    assert [float(s) for s in found.slope] == pytest.approx([rate, 0, 3 * rate])
    assert float(x.sin().slope[0]) == pytest.approx(np.cos(2))
    assert float(x.cos().slope[2]) == pytest.approx(-3 * np.sin(2))
    assert (x / 4).slope[2] == 0.75
    assert x > 1
    assert x < 3


@pytest.mark.slow
def test_where_a_box_is_not_proved_a_smaller_one_is():
    factor, found = find_core(on_the_way(0.93), box_of_poses(-HALF, HALF), SHARE, work=50)
    assert 0 < factor < 1
    assert found.unique
    np.testing.assert_allclose(found.box.high[:6], factor * HALF)
