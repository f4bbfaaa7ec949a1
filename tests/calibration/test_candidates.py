"""Effects of the light as candidates of a calibration: priors, and what is said of a profile."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import facets
from facets.calibration.candidates import candidates, light_unknowns, tried_kinds
from facets.calibration.misfit import centre_sigma, profile_finding
from facets.core import LIGHT_CANDIDATES
from facets.model import EFFECTS

CONFIG = facets.load("paper")
#: The numbers of each candidate, and their standard uncertainties in 1/mm, mm, mm^2, mW and rad.
PRIORS = {
    "curvature": {1e-3: 3},
    "diffraction": {1e-3: 1},
    "rolloff": {3e-4: 6, 0.05: 1},
    "strips": {0.03: 3},
    "tip": {0.01: 1},
    "background": {3e-3: 3, 3.0: 6},
    "coating": {1.0: 1},
    "profile": {0.02: 5},
    "asymmetry": {0.02: 4},
}


def test_every_number_but_an_index_belongs_to_one_candidate():
    found = {key: light_unknowns(key) for key in LIGHT_CANDIDATES}
    for key, sigmas in found.items():
        values = list(sigmas.values())
        assert {value: values.count(value) for value in values} == PRIORS[key]
    names = [name for sigmas in found.values() for name in sigmas]
    assert sorted([*names, "coating.n", "coating.k"]) == sorted(EFFECTS)


def test_a_profile_is_tried_and_its_code_is_compiled_beside_the_others():
    tried = [one.key for one in candidates(CONFIG.sensor, None, CONFIG.calibrate)]
    assert tried[: len(PRIORS)] == list(PRIORS)
    kinds = tried_kinds(CONFIG.sensor, CONFIG.calibrate)
    assert kinds == ["light", "light_polarised", "light_profiled"]


def fitted(**values):
    """A fit of these unknowns, each known to 1e-4."""
    names = tuple(name.replace("_", ".") for name in values)
    return SimpleNamespace(
        choice=SimpleNamespace(names=names),
        values=np.array(list(values.values())),
        uncertainty=np.full(len(names), 1e-4),
    )


def test_a_profile_is_reported_with_its_size():
    """Of 1 + c He_4(x) it is c times the root of 4!."""
    said = profile_finding(fitted(profile_xxxx=0.01, profile_xxyy=0.0))
    assert not said.bad
    assert "not Gaussian: its irradiance deviates by 4.9 %" in said.words
    assert "xxxx 0.01 +- 0.0001" in said.words
    assert "not symmetric" not in said.words
    assert "not symmetric" in profile_finding(fitted(asymmetry_xxx=0.01)).words
    assert profile_finding(fitted(profile_xxxx=3e-4)) is None
    assert profile_finding(fitted(tip_area=0.01)) is None


def test_an_asymmetric_beam_has_an_uncertain_middle():
    """1.5 of the r.m.s. deviation, which is c times the root of 3! of 1 + c He_3(x)."""
    size = 1.5 * 0.02 * np.sqrt(6) * CONFIG.sensor.beam.diameter_x / 4
    settings = replace(CONFIG.calibrate, before={})
    for found, centre in ((fitted(profile_xxxx=0.01), 0.0), (fitted(asymmetry_xxx=0.02), size)):
        remainder = SimpleNamespace(found=found)
        assert centre_sigma(CONFIG.sensor, remainder, settings) == pytest.approx(centre)
