"""Effects that ideal light neglects, and the pose errors that they cause.

    python -m facets.experiments.studies.neglected

Readings of the paper's head with one effect at a time are computed by rays (`bench_rays`) over the
motions of `rigs`, without noise. They are solved with the beam known, as if the light were ideal.
The study prints the r.m.s. error over the uncertainty of one reading, for the worse of x and y and
for the worst other axis. It repeats this after a calibration without the effect, and with the
effect in the model (`sensor.light`). Effects are proportional to their causes. So the inverse of a
number is the factor by which its cause may grow before the effect exceeds the noise. Diffraction at
edges between facets has its closed form, which `tests/optics/references` compare with a scalar
field.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import facets
from facets.calibration.fitting.bundle_adjustment import Data
from facets.calibration.fitting.fit import fit
from facets.calibration.fitting.unknowns import Choice
from facets.core.sensor import BenchLight, Sensor
from facets.core.units import Floats
from facets.detectors.correction import correct

from . import rigs
from .bench_rays import RayBench, spots

ALUMINIUM = (1.37, 7.62)  # at 633 nm
WAVELENGTH = 632.8e-6
#: Second and third orders of a detector's correction.
BENT = ("20", "11", "02", "30", "21", "12", "03")
WAIST_MM = 0.425  # mm, radius to 1/e^2 of the paper's beam


def wavefront(distance: float) -> float:
    """Radius of a Gaussian beam's wavefront, mm, at a distance from its waist."""
    rayleigh = np.pi * WAIST_MM**2 / WAVELENGTH
    return float(distance * (1 + (rayleigh / distance) ** 2))


#: A tenth of a wave over the last 0.1 mm, and a little less.
DEPTHS_MM = (6.3e-5, 4e-5, 5e-5, 6e-5, 3e-5, 5e-5)


class NeglectedEffect(NamedTuple):
    """The light of a bench, and the sensor whose model has the effect."""

    bench: RayBench
    sensor: Sensor


def effect_case(sensor: Sensor) -> NeglectedEffect:
    """The case in which the bench has an effect that `sensor` describes exactly."""
    return NeglectedEffect(RayBench.from_sensor(sensor), sensor)


def light_case(**light: Any) -> NeglectedEffect:
    """Effects of `sensor.light`, by rays, and the same in the model."""
    return effect_case(replace(facets.Sensor(), light=BenchLight(**light)))


def cases() -> dict[str, NeglectedEffect]:
    """Each effect by its name."""
    nominal = facets.Sensor()
    beam = nominal.beam
    dome, bend = 8 * (WAVELENGTH / 10) / 5.0**2, 1 / wavefront(500.0)
    wide = replace(nominal, beam=replace(beam, diameter_x=1.05 * beam.diameter_x))
    tilted = replace(nominal, beam=replace(beam, tilt_x=1.4e-3, tilt_y=-1.4e-3))
    domed = RayBench.from_sensor(nominal)._replace(domes=(dome, -dome, dome))
    return {
        "aluminium; light unpolarised": light_case(index=ALUMINIUM),
        "aluminium; light polarised": light_case(index=ALUMINIUM, polarization=0.3),
        "ellipticity 5 %": effect_case(wide),
        "beam tilt 2 mrad": effect_case(tilted),
        "divergence; 0.5 m from a HeNe": light_case(curvature_xx=bend, curvature_yy=bend),
        "diffraction at the edges": light_case(wavelength=WAVELENGTH),
        "edges rolled off 63 nm within 0.05 mm": light_case(rolloff=DEPTHS_MM, rolloff_width=0.1),
        "strips of 10, 14, 8 um lost at edges": light_case(strips=(0.01, 0.014, 0.008)),
        "a flat tip, 25 um in radius": light_case(tip=np.pi * 0.025**2),
        "other light, 0.5 uW on each": light_case(
            background=((5e-4, 1, 2), (5e-4, -1, 1), (5e-4, 0, -2))
        ),
        "facets domed by a tenth wave over 5 mm": NeglectedEffect(domed, nominal),
    }


def calibrated_unknowns() -> Choice:
    """The unknowns of `rigs`, the beam's cross-section, and detectors that are not linear."""
    sigmas = rigs.hidden() | {"beam.sigma_xx": 4e-3, "beam.sigma_yy": 4e-3, "beam.sigma_xy": 2e-3}
    sigmas |= {f"correction_{k}.{a}{p}": 0.05 for k in "abc" for a in "yz" for p in BENT}
    return Choice(tuple(sigmas), np.array(list(sigmas.values())))


def draw_samples(
    effect: NeglectedEffect, count: int, rng: np.random.Generator
) -> tuple[Data, Floats]:
    """Samples of a random motion with exact readings and exact poses, and their states (n, 8)."""
    pose = rng.uniform(-1, 1, (count, 6)) * rigs.BOX
    state = np.concatenate([pose, np.zeros((count, 2))], axis=1)
    exact = spots(effect.sensor, effect.bench, state)
    return Data(exact, pose, rigs.REFERENCE, np.zeros((count, 2))), state


def errors_over_noise(sensor: Sensor, data: Data, state: Floats, apex: Floats) -> Floats:
    """R.m.s. errors (2,) over one reading's uncertainty: the worse of x and y, the worst other."""
    solution = facets.solve(sensor, correct(sensor, data.raw), beam="known")
    error = (solution.state - state)[:, :6]
    error[:, :2] -= apex
    noise = facets.solve(facets.Sensor(), data.raw, beam="known").uncertainty[:, :6]
    ratio = rigs.rms(error) / rigs.rms(noise)
    return np.array([ratio[:2].max(), ratio[2:].max()])


def compare_optics() -> list[tuple[Any, ...]]:
    """(what, then in x and y and in others: before, after calibration, in the model)."""
    rows: list[tuple[Any, ...]] = []
    still = np.zeros(2)
    for name, effect in cases().items():
        rng = np.random.default_rng(1)
        data, _ = draw_samples(effect, 150, rng)
        fresh, state = draw_samples(effect, 200, rng)
        before = errors_over_noise(facets.Sensor(), fresh, state, still)
        fitted = fit(facets.Sensor(), data, calibrated_unknowns(), None)
        after = errors_over_noise(fitted.sensor, fresh, state, fitted.apex[:2])
        best = errors_over_noise(effect.sensor, fresh, state, still)
        rows.append((name, *before.tolist(), *after.tolist(), *best.tolist()))
    return rows


def main() -> None:
    rows = compare_optics()
    print("r.m.s. error over the noise of one reading: light ideal, calibrated so, in the model")
    print(f"{'':42}" + f" {'x; y':>8} {'others':>8}" * 3)
    for name, *numbers in rows:
        print(f"{name:42} " + " ".join(f"{number:8.2g}" for number in numbers))


if __name__ == "__main__":
    main()
