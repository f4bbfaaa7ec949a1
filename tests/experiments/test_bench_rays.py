"""The tracer of rays of tests and studies: textbook values of what the model does not have."""

import numpy as np
import pytest
from facets.experiments.studies.bench_rays import RayBench, spots

import facets


def test_a_dome_enlarges_places_as_a_mirror_of_its_radius():
    """Along the plane of incidence at 45 degrees a mirror of radius R has the power 2 sqrt 2 / R;
    the detectors are 250 mm away."""
    sensor, rest, radius = facets.Sensor(), np.zeros((1, 8)), 31250.0
    domed = RayBench.from_sensor(sensor)._replace(domes=(1 / radius,) * 3)
    wide = spots(sensor, domed, rest)[0, 1] / facets.readings(sensor, rest)[0, 1]
    assert wide == pytest.approx(1 + 250 * 2 * np.sqrt(2) / radius, rel=2e-3)
