"""The rig's page can be made, whatever part of the package changes: its solver is their text."""

from __future__ import annotations

import numpy as np
import pytest

import facets
from facets.pictures import rig_page


@pytest.mark.parametrize("name", ["paper", "bench-light"])
def test_the_page_of_a_shipped_sensor_is_made(name):
    config = facets.load(name)
    text = rig_page(config.sensor, name, np.zeros(8), config=config)
    assert "gauss_newton_estimate_each" in text
