"""Sensors for experiments: the paper's, and ten without any symmetry."""

import numpy as np

from facets import Beam, Facet, Psd, Sensor
from facets.core.units import Floats

from .bench_rays import RayBeam, facet_normals


def sub_beam(beam: Beam, facet: Facet) -> Floats:
    """Direction (3,) of the beam after a facet at the mirror's zero pose."""
    down, (normal,) = RayBeam.from_beam(beam).along, facet_normals([facet])
    leaving: Floats = down - 2 * (down @ normal) * normal
    return leaving


def skew_sensor(seed: int) -> Sensor:
    """Make a sensor whose parameters differ more than any rig's; each detector is near its spot."""
    rng = np.random.default_rng(seed)
    beam = Beam(
        power=rng.uniform(0.1, 5),
        diameter_x=rng.uniform(0.5, 1.2),
        diameter_y=rng.uniform(0.5, 1.2),
        rotation=rng.uniform(0, np.pi),
        tilt_x=rng.uniform(-0.02, 0.02),
        tilt_y=rng.uniform(-0.02, 0.02),
    )
    facets, psds = [], []
    for k in range(3):
        facet = Facet(
            inclination=np.radians(45 + rng.uniform(-4, 4)),
            azimuth=2 * np.pi * k / 3 + np.radians(rng.uniform(-10, 10)),
        )
        ray = sub_beam(beam, facet)
        radius = rng.uniform(150, 300)
        psd = Psd(
            radius=radius,
            azimuth=np.arctan2(ray[1], ray[0]) + rng.uniform(-2, 2) / radius,
            height=radius * ray[2] / np.hypot(ray[0], ray[1]) + rng.uniform(-2, 2),
            roll=rng.uniform(-0.2, 0.2),
            pitch=rng.uniform(-0.2, 0.2),
            yaw=rng.uniform(-0.2, 0.2),
            size_y=rng.uniform(10, 20),
            size_z=rng.uniform(10, 20),
        )
        facets.append(facet)
        psds.append(psd)
    a, b, c = facets
    on_a, on_b, on_c = psds
    return Sensor(beam=beam, facets=(a, b, c), psds=(on_a, on_b, on_c))


SENSORS = {"paper": Sensor(), **{f"skewed{seed}": skew_sensor(seed) for seed in range(10)}}
