"""The paper's Table 2 beside the model: ranges and resolutions of six axes, fixed and following.

    python -m facets.experiments.table2 [--output FILE.csv]

Two numbers are fitted, both in configs/paper.yaml. The position noise, 2.6 um at 0.1 mW (1 sigma),
to the resolutions in z, roll, pitch and yaw: twice the worst standard deviation of the paper's
inversion, light shared evenly. The least signal-to-noise ratio, 810, to the ranges in x and y under
a fixed beam. Ranges go equally far to both sides.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import facets
from facets.names import POSE
from facets.plots import unit_of
from facets.ranges import axis_ranges
from facets.resolution import estimators, resolve
from facets.rules import Rules
from facets.tables import write_table

#: mm and mrad, um and urad; x and y also with the beam following.
RANGE = (0.36, 0.39, 12.3, 28.0, 24.5, 48.0)
FOLLOWING = (13.6, 11.8)
RESOLUTION = (2.6, 1.9, 2.8, 9.4, 8.7, 13.0)

Row = tuple[str, str, str, float, float, float]


def rows(sensor: facets.Sensor) -> list[Row]:
    """(quantity, axis, unit, paper, model, model over paper)."""
    found: list[Row] = []
    for tracking, measured in ((False, RANGE), (True, FOLLOWING)):
        ranges = axis_ranges(sensor, Rules(tracking=tracking), np.zeros(6))
        for axis, paper in zip(ranges, measured, strict=False):
            unit, factor, _, _ = unit_of(axis.name)
            model = factor * axis.symmetric
            title = "range, beam following" if tracking else "range, beam fixed"
            found.append((title.replace(",", ";"), axis.name, unit, paper, model, model / paper))
    for tracking in (True, False):
        inversion = resolve(sensor, Rules(tracking=tracking), estimators(0.005))[0]
        for name, paper, worst in zip(POSE, RESOLUTION, inversion.worst, strict=True):
            _, _, unit, factor = unit_of(name)
            model = 2 * factor * worst
            title = f"resolution; beam {'following' if tracking else 'fixed'}"
            found.append((title, name, unit.replace("µ", "u"), paper, model, model / paper))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    found = rows(facets.Sensor())
    for title, name, unit, paper, model, ratio in found:
        print(f"{title:28} {name:6} {paper:7.4g} {model:8.4g} {unit:5} ratio {ratio:.3f}")
    if options.output:
        names = ("quantity", "axis", "unit", "paper", "model", "ratio")
        columns = dict(zip(names, map(list, zip(*found, strict=True)), strict=True))
        write_table(options.output, columns, {"facets": facets.__version__})


if __name__ == "__main__":
    main()
