"""Solve readings of a sensor by the way that tables, runs and simulations share."""

from dataclasses import replace

import facets
from facets import Measurement, Samples, Solution
from facets.core.settings import Solve


def measure(sensor: facets.Sensor, options: Solve, samples: Samples) -> Solution:
    config = replace(facets.load("paper"), sensor=sensor, solve=options)
    return Measurement(config).poses(samples).solution
