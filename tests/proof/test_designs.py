"""The proof for what a search has found, within a stated amount of work."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from facets.cli.design_space import proof_margins
from facets.cli.optimize import prove

import facets
from facets.proof.designs import certify_design, proof_margin


def small_range(config):
    """Detectors on which a spot has little way to go: a small box."""
    psds = tuple(replace(psd, size_y=3.0, size_z=3.0) for psd in config.sensor.psds)
    return replace(config, sensor=replace(config.sensor, psds=psds))


def without_range(config):
    psds = tuple(replace(psd, size_y=0.1, size_z=0.1) for psd in config.sensor.psds)
    return replace(config, sensor=replace(config.sensor, psds=psds))


@pytest.mark.slow
def test_a_design_is_proved_and_told():
    config = small_range(facets.load("paper"))
    found = certify_design(config.sensor, config.range)
    assert found.unique
    assert proof_margin(config.sensor, config.range) == found.margin
    told = prove(config, 400)
    assert told.startswith("proved: no two states within the ranges of the axes and with at least")
    assert "10.8 % of the light on each detector (32.4 µW of a laser of 0.3 mW or less)" in told


@pytest.mark.slow
def test_a_design_that_is_not_proved_is_told():
    config = facets.load("singular")
    assert not certify_design(config.sensor, config.range, work=10).unique
    assert np.isnan(proof_margin(config.sensor, config.range, work=10))
    out = prove(config, 10)
    assert out.startswith("not proved")
    assert "facets jacobian --certify" in out


def test_a_design_without_a_range_is_told():
    config = without_range(facets.load("paper"))
    assert "leaves the PSD" in certify_design(config.sensor, config.range)
    assert np.isnan(proof_margin(config.sensor, config.range))
    assert "leaves the PSD" in prove(config, 10)


@pytest.mark.slow
def test_the_front_has_a_margin_of_each_design(capsys):
    config = small_range(facets.load("paper"))
    space = SimpleNamespace(sensor=config.sensor, rules=config.range, names=["radius_mm"])
    table = {"radius_mm": np.array([250.0, 200.0])}
    margins = proof_margins(space, table, 400)
    assert margins[0] == pytest.approx(proof_margin(config.sensor, config.range), rel=1e-6)
    assert (margins > 0).all()
    assert "of the front's 2 designs, 2 are proved" in capsys.readouterr().out
