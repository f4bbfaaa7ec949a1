"""The proof for what a search has found, within a stated amount of work."""

from __future__ import annotations

from dataclasses import replace

import pytest
from facets.cli.sentences import certificate

import facets

CONFIG = facets.load("paper")


def test_of_a_design_without_a_range_or_a_proof_nothing_is_claimed():
    psds = tuple(replace(psd, size_y=0.1, size_z=0.1) for psd in CONFIG.sensor.psds)
    small = replace(CONFIG.sensor, psds=psds)
    curved = replace(CONFIG.sensor, light=facets.BenchLight(curvature_xx=1e-6))
    for sensor, reason in ((small, "leaves the PSD"), (curved, "sensor.light is not")):
        text = certificate.prove_design(replace(CONFIG, sensor=sensor), 400)
        assert text.startswith("not proved that readings determine states: ")
        assert reason in text


@pytest.mark.slow
def test_a_design_that_is_not_proved_in_the_work_allowed_is_told():
    text = certificate.prove_design(facets.load("singular"), 10)
    assert text.startswith("not proved that readings determine states within the ranges")
    assert "facets jacobian --certify" in text
