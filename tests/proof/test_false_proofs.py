"""What is proved of random sensors holds before a search that shares no code with the proof."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from facets.experiments.check_certificate import check
from facets.experiments.studies import false_proofs
from sensors import SENSORS, states

import facets
from facets.characterization import parse_box
from facets.proof import Certificate, certify, write_certificate


@pytest.mark.parametrize("name", ["paper", "skewed1"])
def test_the_search_has_a_model_of_its_own_that_agrees(name):
    sensor, state = SENSORS[name], states(50, seed=5)
    model = false_proofs.model_of(sensor)
    np.testing.assert_allclose(model(state), facets.readings(sensor, state), atol=1e-10)
    np.testing.assert_allclose(model.slopes(state), facets.jacobian(sensor, state), atol=1e-4)


@pytest.mark.slow
def test_the_search_breaks_what_is_not_so():
    sensor, rng = facets.load("singular").sensor, np.random.default_rng(1)
    box = parse_box(  # beyond the range, which ends at singular poses
        "tx_mm=2,ty_mm=5,tz_mm=3,roll_mrad=6,pitch_mrad=3,yaw_mrad=20,offset_x_mm=0.2,"
        "offset_y_mm=0.2"
    )
    case = false_proofs.ProofCase(sensor, box, 0.108)
    model = false_proofs.model_of(sensor)
    assert false_proofs.breaks_uniqueness(case, model, rng)
    assert false_proofs.breaks_bound(case, model, Certificate(box, at_least=1e6), rng)


@pytest.mark.slow
def test_nothing_is_proved_that_the_search_breaks():
    counts = false_proofs.study(2, seed=1)
    assert counts["broken"] == 0
    assert counts["unique"] >= 1


@pytest.mark.slow
def test_the_checker_s_bound_holds_for_a_beam_that_leans(tmp_path):
    """Also in a file whose bound of the powers' slope is forged to be the largest valid one:
    without the beam's tilt in its bound, the checker shows a tenth more than a state has."""
    sensor, path = SENSORS["paper"], tmp_path / "certificate.json"
    beam = replace(sensor.beam, tilt_x=0.6, diameter_x=1.3, diameter_y=0.85)
    box = parse_box("tx_mm=3:3.001,ty_mm=-2:-2,tz_mm=1:1.01")
    case = false_proofs.ProofCase(replace(sensor, beam=beam), box, 0.3)
    model = false_proofs.model_of(case.sensor)
    proof = certify(case.sensor, case.box, case.least_share)
    assert proof.unique
    slopes = model.slopes(false_proofs.states_of(case, model, 40_000, np.random.default_rng(1)))
    least = np.abs(np.linalg.det(slopes[:, :8])).min()
    assert proof.at_least < least
    write_certificate(path, case.sensor, proof, {"config": "leaning"})
    assert float(check(path).determinant) < least
    by_offset = np.linalg.det(slopes[:, [2, 5], 6:]) * model.sigma.prod() / model.power**2
    content = json.loads(path.read_text())
    content["light"]["slope"][0] = 0.99 * float(np.abs(by_offset / model.down[2]).min())
    path.write_text(json.dumps(content))
    assert float(check(path).determinant) < least
