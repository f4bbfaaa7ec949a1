"""How far the paper's irradiance, Eq. (7) to (9), is from exact.

    python -m facets.experiments.paper_irradiance [--output FILE.csv]

Eq. (8) leaves out a cross term, which vanishes where the sub-beam leaves the facet level. For tilts
of one axis or of all, and for the mirror centred or 0.1 mm off the beam: the largest error of a
spot's place over the three detectors, and of a power relative to the beam's.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import facets
from facets.tables import write_table

AXES = {"roll": (1, 0, 0), "pitch": (0, 1, 0), "yaw": (0, 0, 1), "all three": (1, 1, 1)}
TILTS = (2, 5, 10, 20)
OFFSETS = (0.0, 0.1)


def errors(sensor: facets.Sensor, state: np.ndarray) -> tuple[float, float]:
    """Of a place, nm, and of a power, parts per million of the beam's."""
    printed = facets.readings(sensor, state, irradiance="paper")
    difference = np.abs(printed - facets.readings(sensor, state)).reshape(3, 3)
    return 1e6 * difference[:, :2].max(), 1e6 * difference[:, 2].max() / sensor.beam.power


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    rows = []
    for offset in OFFSETS:
        for name, turn in AXES.items():
            for tilt in TILTS:
                state = np.array([offset, 0, 0, *(1e-3 * tilt * np.array(turn)), 0, 0])
                rows.append((offset, name, tilt, *errors(facets.Sensor(), state)))
    names = ("offset_mm", "axis", "tilt_mrad", "place_nm", "power_ppm")
    print("{:>10} {:>10} {:>10} {:>10} {:>10}".format(*names))
    for row in rows:
        print("{:10.1f} {:>10} {:10d} {:10.2g} {:10.2g}".format(*row))
    if options.output:
        columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
        write_table(options.output, columns, {"facets": facets.__version__})


if __name__ == "__main__":
    main()
