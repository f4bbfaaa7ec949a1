"""The proof for what a search has found, within a stated amount of work."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
from facets.cli.sentences import certificate

import facets
from facets import proof
from facets.characterization import least_share, range_box
from facets.proof import certify

CONFIG = facets.load("paper")


def test_of_a_design_without_a_range_or_a_proof_nothing_is_claimed():
    psds = tuple(replace(psd, size_y=0.1, size_z=0.1) for psd in CONFIG.sensor.psds)
    small = replace(CONFIG.sensor, psds=psds)
    curved = replace(CONFIG.sensor, light=facets.BenchLight(curvature_xx=1e-6))
    for sensor, reason in ((small, "leaves the PSD"), (curved, "sensor.light is not")):
        assert np.isnan(proof.designs.proof_margin(sensor, CONFIG.range))
        text = certificate.prove_design(replace(CONFIG, sensor=sensor), 400)
        assert text.startswith("not proved that readings determine states: ")
        assert reason in text


@pytest.mark.slow
def test_a_design_that_is_not_proved_in_the_work_allowed_is_told():
    text = certificate.prove_design(facets.load("singular"), 10)
    assert text.startswith("not proved that readings determine states within the ranges")
    assert "facets jacobian --certify" in text


@pytest.mark.slow
def test_the_front_has_a_margin_of_each_design(run_in_process, tmp_path):
    """On small detectors a spot has little way to go: the boxes are small."""
    (tmp_path / "small.yaml").write_text(
        "extends: paper\nsensor: {psd: {size_mm: 3}}\n"
        "optimize: {variables: {radius_mm: [200, 250]}}\n"
    )
    status, text, errors = run_in_process(
        "explore", "small.yaml", "--designs", "2", "--sampling", "grid", "-d", "out",
        "--objective", "head_mm", "--objective", "u_roll_urad", "--certify", "400",
        "--table", "csv",
    )  # fmt: skip
    assert status == 0, errors
    assert "of the front's 2 designs, 2 are proved" in text
    lines = (tmp_path / "out" / "front.csv").read_text().splitlines()
    rows = {float(row["radius_mm"]): float(row["proof_margin"])
            for row in csv.DictReader(line for line in lines if line[0] != "#")}  # fmt: skip
    config = facets.load(tmp_path / "small.yaml")
    box, share = range_box(config.sensor, config.range), least_share(config.sensor, config.range)
    assert rows[250] == pytest.approx(certify(config.sensor, box, share).margin, rel=1e-6)
    assert rows[200] > 0
