"""Near the singular sensor the hull of all Jacobians is not regular, but the middles' are."""

from __future__ import annotations

import json

import numpy as np
import pytest
from facets.experiments import certificate_pieces, certificate_schema, check_certificate
from flint import arb
from sensors import lit_states

import facets
from facets.characterization import box_of_poses
from facets.model import parameters, sensor_with
from facets.proof import certify, edges_over_rotations, middles, write_certificate
from facets.proof.light_sharing import bounds_at_fixed_shares, hull_of_bounds
from facets.proof.spot_jacobian import centred_jacobian, interval_geometry, spot_jacobian
from facets.scalars import intervals

HALF = np.array([5, 5, 5, 0.012, 0.012, 0.02])
#: Wider in four axes, and without the others.
WIDE = np.array([7.5, 7.5, 7.5, 0.018, 0, 0])
SHARE = 0.15


def between(part):
    """A sensor between the paper's and the singular one."""
    first, last = (np.array(parameters(facets.load(n).sensor)) for n in ("paper", "singular"))
    return sensor_with(facets.load("paper").sensor, (first + part * (last - first)).tolist())


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    path = tmp_path_factory.mktemp("middles") / "certificate.json"
    sensor = between(0.85)
    certificate = certify(sensor, box_of_poses(-WIDE, WIDE), SHARE)
    assert certificate.unique
    assert certificate.regular
    assert certificate.middles is not None
    write_certificate(path, sensor, certificate, {"config": "on the way"})
    return json.loads(path.read_text())


def check(content, folder):
    path = folder / "certificate.json"
    path.write_text(json.dumps(content))
    return check_certificate.check(path)


def test_it_is_checked_again_and_its_bound_holds(content, tmp_path):
    checked = check(content, tmp_path)
    assert content["margin"] / 2 < checked.margin < 1
    assert checked.determinant > 0
    sensor, rng = between(0.85), np.random.default_rng(1)
    matrices = facets.jacobian(sensor, lit_states(sensor, -WIDE, WIDE, SHARE, 3000, rng))
    least = np.abs(np.linalg.det(np.delete(matrices, 8, axis=1))).min()
    assert max(checked.determinant, content["least_determinant"]) <= least


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"middles": None}, "least piece|singular"),
        ({"slopes": [[[0.0] * 6] * 6] * 6}, "singular"),
        ({"least_determinant": 1e20}, "larger determinant"),
    ],
)
def test_what_is_forged_is_refused_with_a_reason(content, tmp_path, changes, reason, monkeypatch):
    monkeypatch.setattr(certificate_pieces, "MOST", 30)
    if "slopes" in changes:
        changes = {"middles": content["middles"] | changes}
    with pytest.raises(certificate_schema.Refused, match=reason):
        check(content | changes, tmp_path)


@pytest.mark.slow
def test_nothing_is_proved_past_the_singular_sensor():
    assert not certify(between(1.0), box_of_poses(-HALF, HALF), SHARE, pieces=150).unique


@pytest.fixture(scope="module")
def light():
    """A sensor's vectors in intervals, and bounds of its light over the box."""
    ball = interval_geometry(between(0.5))
    parts = edges_over_rotations(ball, box_of_poses(-HALF, HALF))
    return ball, hull_of_bounds([bounds_at_fixed_shares(edges, SHARE) for edges in parts])


def test_jacobians_of_a_piece_lie_in_what_its_slopes_make_of_the_middle(light):
    low, high = np.array([1, -2, 0, 0.001, -0.004, 0]), np.array([2, 1, 4, 0.005, 0.004, 0.009])
    whole, rng = centred_jacobian(*light, low, high).enclosure(), np.random.default_rng(2)
    for _ in range(30):
        pose = [arb(float(x)) for x in low + rng.integers(0, 3, 6) / 2 * (high - low)]
        single = spot_jacobian(*light, pose)
        for inner, outer in zip(np.ravel(single), np.ravel(whole), strict=True):
            (low_in, high_in), (low_out, high_out) = intervals.ends(inner), intervals.ends(outer)
            assert low_out <= low_in + 1e-9 * abs(low_in)
            assert high_out >= high_in - 1e-9 * abs(high_in)


def test_the_affine_part_may_be_anything(light):
    """It proves the less the further it is off, and nothing that is not so."""
    over = centred_jacobian(*light, -HALF / 2, HALF / 2)
    affine = middles.affine_part(*light, box_of_poses(-HALF / 2, HALF / 2))
    sizes = []
    for part in (affine, affine._replace(slopes=-affine.slopes)):
        rest = middles.affine_remainder(part, over)
        whole = part.evaluate(np.array([intervals.interval(-x, x) for x in HALF / 2])) + rest
        sizes.append(sum(float(x.rad()) for row in rest for x in row))
        for row, exact in zip(whole, over.middle, strict=True):
            assert all(x.contains(y) for x, y in zip(row, exact, strict=True))
    assert sizes[0] < sizes[1]
