"""The sensor: one beam, three facets, three position-sensitive detectors, and their noise.

Lengths in mm, angles in rad, powers in mW. Defaults are the rig of Park & Cho, Table 1.
Every object is frozen and checks itself; a `Sensor` is plain data and knows no optics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from math import pi
from typing import Any

from .arguments import checked
from .errors import InputError
from .names import DETECTORS


def _require(condition: bool, what: str, value: object, allowed: str) -> None:
    if not condition:
        raise InputError(f"{what} is {value}; allowed: {allowed}")


def _require_finite(thing: object) -> None:
    for field in fields(thing):  # type: ignore[arg-type]
        value = getattr(thing, field.name)
        if isinstance(value, int | float):
            _require(math.isfinite(value), field.name, value, "a finite number")


@checked
@dataclass(frozen=True)
class Beam:
    """A collimated Gaussian beam. Its centre (bx, by) in the x_w y_w plane is part of the state.

    power: mW.  diameter_x, diameter_y: 1/e^2 diameters along the beam's own axes, mm.
    rotation: of those axes about the beam, rad.
    tilt_x, tilt_y: of the beam about x_w, then y_w, from straight down (0, 0, -1), rad.
    """

    power: float = 0.3
    diameter_x: float = 0.85
    diameter_y: float = 0.85
    rotation: float = 0.0
    tilt_x: float = 0.0
    tilt_y: float = 0.0

    def __post_init__(self) -> None:
        _require_finite(self)
        _require(self.power > 0, "beam power", self.power, "above 0 mW")
        for name in ("diameter_x", "diameter_y"):
            _require(getattr(self, name) > 0, f"beam {name}", getattr(self, name), "above 0 mm")


@checked
@dataclass(frozen=True)
class Facet:
    """One reflecting side of the mirror, through the apex, in the mirror frame.

    inclination: of its normal from the mirror's axis, rad, between 0 and pi/2.
    azimuth: of its normal about the mirror's axis, rad.
    """

    inclination: float = pi / 4
    azimuth: float = 0.0

    def __post_init__(self) -> None:
        _require_finite(self)
        _require(
            0 < self.inclination < pi / 2, "facet inclination", self.inclination, "0 to pi/2 rad"
        )


#: Powers of y and of z, in half sizes, in what is added to a place that a detector reads.
MONOMIALS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))


@checked
@dataclass(frozen=True)
class Grid:
    """What is added to a detector's places, as measured on a grid, straight in between; mm.

    y: (n), z: (m) where, going up.  add_y, add_z: (n, m) as nested tuples.
    """

    y: tuple[float, ...]
    z: tuple[float, ...]
    add_y: tuple[tuple[float, ...], ...]
    add_z: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        for name in ("y", "z"):
            places = getattr(self, name)
            up = len(places) > 1 and all(a < b for a, b in pairwise(places))
            _require(up, f"{name} of a grid", places, "two places or more, going up")
        for name in ("add_y", "add_z"):
            rows = getattr(self, name)
            whole = len(rows) == len(self.y) and all(len(row) == len(self.z) for row in rows)
            _require(whole, f"size of {name}", len(rows), f"{len(self.y)} x {len(self.z)}")


@checked
@dataclass(frozen=True)
class Correction:
    """What a calibration adds to what a detector reads.

    power: share added to the power.  dark: added to it besides, mW.  y, z: coefficients (mm) of
    `MONOMIALS` added to psi and zeta.  grid: added to both besides, as measured.
    """

    power: float = 0.0
    dark: float = 0.0
    y: tuple[float, ...] = (0.0,) * len(MONOMIALS)
    z: tuple[float, ...] = (0.0,) * len(MONOMIALS)
    grid: Grid | None = None

    def __post_init__(self) -> None:
        _require_finite(self)
        _require(self.power > -1, "correction of the power", self.power, "above -1")
        for name in ("y", "z"):
            count = len(getattr(self, name))
            _require(count == len(MONOMIALS), f"correction {name}", count, "9 coefficients")


@checked
@dataclass(frozen=True)
class Psd:
    """A position-sensitive detector.

    radius, azimuth, height: its centre in cylinder coordinates of the world frame, mm, rad, mm.
    roll, pitch, yaw: its turn, R = Rz(yaw) Ry(pitch) Rx(roll), from the nominal orientation in
    which x points radially outward, z up and y = z cross x; rad.
    size_y, size_z: its sensitive area, mm.  correction: of what it reads.
    """

    radius: float = 250.0
    azimuth: float = 0.0
    height: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0
    size_y: float = 13.0
    size_z: float = 13.0
    correction: Correction = Correction()

    def __post_init__(self) -> None:
        _require_finite(self)
        for name in ("radius", "size_y", "size_z"):
            _require(getattr(self, name) > 0, f"PSD {name}", getattr(self, name), "above 0 mm")


@checked
@dataclass(frozen=True)
class Noise:
    """Gaussian noise of the readings, independent from reading to reading; 1 sigma.

    position: of a centroid, mm, at the stated `at_power`, mW; it grows as 1/power.
    power: of a power reading, mW.
    """

    position: float = 0.0026
    at_power: float = 0.1
    power: float = 4e-5

    def __post_init__(self) -> None:
        _require_finite(self)
        for name in ("position", "at_power", "power"):
            _require(getattr(self, name) > 0, f"noise {name}", getattr(self, name), "above 0")


@checked
@dataclass(frozen=True)
class Electronics:
    """The detectors' electronics, from which their noise follows (`facets.detectors.noise`).

    kind: of the PSDs: "duo-lateral", "pincushion" or "tetra-lateral".
    responsivity: A/W.  dark_current: of a PSD, A.  resistance: between electrodes, ohm.
    transimpedance: of each electrode's amplifier, ohm (V/A); voltage_noise, current_noise: of the
    amplifier, V and A per root Hz.  bandwidth: Hz.  temperature: K.
    adc_bits, adc_range: of the converter behind it, V full scale.
    ambient: background light on a PSD, mW; its mean is taken off, its noise stays.
    power_noise: of the laser, relative, from sample to sample.  pointing: jitter of the beam's
    place in x and y, mm.
    """

    kind: str = "duo-lateral"
    responsivity: float = 0.4
    dark_current: float = 1e-8
    resistance: float = 1e4
    transimpedance: float = 1e5
    voltage_noise: float = 1e-8
    current_noise: float = 1e-12
    bandwidth: float = 1e4
    temperature: float = 296.0
    adc_bits: int = 16
    adc_range: float = 10.0
    ambient: float = 0.0
    power_noise: float = 0.0
    pointing: float = 0.0

    def __post_init__(self) -> None:
        _require_finite(self)
        kinds = ("duo-lateral", "pincushion", "tetra-lateral")
        _require(self.kind in kinds, "PSD kind", self.kind, ", ".join(kinds))
        for name in ("responsivity", "resistance", "transimpedance", "bandwidth", "adc_range"):
            _require(getattr(self, name) > 0, name, getattr(self, name), "above 0")
        for name in (
            "dark_current", "voltage_noise", "current_noise", "temperature", "ambient",
            "power_noise", "pointing",
        ):  # fmt: skip
            _require(getattr(self, name) >= 0, name, getattr(self, name), "0 or more")
        _require(1 <= self.adc_bits <= 32, "adc_bits", self.adc_bits, "1 to 32")


@checked
@dataclass(frozen=True)
class Apertures:
    """What cuts the light, beside the facets' edges; by default nothing does.

    beam: diameter of an aperture in the beam over the beam's 1/e^2 diameter; of the beam's own
    shape and centred on it, so 1 cuts where the irradiance has fallen to 1/e^2.
    detectors: whether the light past a PSD's sensitive area is lost. The solver then takes a spot
    that an edge cuts for out of range: its middle hardly moves while the spot goes on.
    tip, rim: the mirror reflects from `tip` to `rim` off its axis, counted towards where a facet
    faces, so that both its flat top and its foot are bounded by straight edges; mm.
    gap: width of the strip that is lost along each edge, half of it on either facet, mm.
    """

    beam: float = math.inf
    detectors: bool = False
    tip: float = 0.0
    rim: float = math.inf
    gap: float = 0.0

    def __post_init__(self) -> None:
        _require(self.beam > 0, "aperture of the beam", self.beam, "above 0")
        for name in ("tip", "gap"):
            value = getattr(self, name)
            _require(0 <= value < math.inf, f"mirror {name}", value, "0 or more, mm, and finite")
        _require(self.rim > self.tip, "mirror rim", self.rim, "above its tip, mm")

    @property
    def cut(self) -> bool:
        """Whether anything does."""
        return self != Apertures()


#: Where a facet meets an edge, in the order of `BenchLight.rolloff`: facet by facet, first edge and
#: second edge, counter-clockwise seen from above.
FACET_EDGES = ("edge_ca_a", "edge_ab_a", "edge_ab_b", "edge_bc_b", "edge_bc_c", "edge_ca_c")
#: The mirror's edges in the order of `BenchLight.strips`: edge number k is where facet k begins.
EDGES = ("ca", "ab", "bc")


#: Fields of `BenchLight` that do not go with apertures, and what to do about each.
REMEDIES = {
    **dict.fromkeys(
        ("curvature_xx", "curvature_xy", "curvature_yy"),
        "light that is cut is modelled as collimated only",
    ),
    "wavelength": "an aperture's own edge would diffract too, which is not modelled",
    "rolloff": "how much light is left along an edge that is cut short is not modelled",
    "strips": "for strips of one width along all edges use apertures.gap alone",
    "tip": "for a flat tip use apertures.tip alone",
}


@checked
@dataclass(frozen=True)
class BenchLight:
    """What the light of a real bench does, in the model of every reading; by default nothing.

    curvature_xx, curvature_xy, curvature_yy: of the wavefront where the beam passes (bx, by, 0),
    one over its radius, positive where it spreads, 1/mm; along the world's x and y as the beam's
    tilt carries them, whatever the rotation of its ellipse.
    wavelength: for the diffraction at the facets' edges, mm; 0 for none.
    rolloff: how much lower the surface lies at an edge than its facet's plane, for `FACET_EDGES`,
    mm.  rolloff_width: of the strip over which it falls evenly, mm, narrow beside the beam.
    strips: width of the strip that is lost along each of `EDGES`, half of it on either facet, mm.
    tip: area, square to the mirror's axis, that is lost at a worn apex, mm^2.
    background: other light on detectors A, B and C: power (mW) and its centroid's y and z (mm).
    index: complex refractive index (n, k) of the facets' coating, None for one that reflects all.
    polarization: angle of the light's field from that x axis, rad; None for unpolarised.
    delays: by how much detectors A, B and C are read later than the stated time, s. They belong to
    recordings, not to single readings (`facets.detectors.skew`).
    """

    curvature_xx: float = 0.0
    curvature_xy: float = 0.0
    curvature_yy: float = 0.0
    wavelength: float = 0.0
    rolloff: tuple[float, ...] = (0.0,) * 6
    rolloff_width: float = 0.0
    strips: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip: float = 0.0
    background: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),) * 3
    index: tuple[float, float] | None = None
    polarization: float | None = None
    delays: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _require_finite(self)
        _require(self.wavelength >= 0, "wavelength", self.wavelength, "0 or more, mm")
        _require(self.rolloff_width >= 0, "rolloff_width", self.rolloff_width, "0 or more, mm")
        for name, count in (("rolloff", 6), ("strips", 3), ("delays", 3)):
            values = getattr(self, name)
            sound = len(values) == count and all(math.isfinite(value) for value in values)
            _require(sound, name, values, f"{count} finite numbers")
        rows = [value for row in self.background for value in row]
        sound = [len(row) for row in self.background] == [3, 3, 3] and all(map(math.isfinite, rows))
        _require(sound, "background", self.background, "power, y and z of three detectors")
        if self.index is not None:
            n, k = self.index
            sound = math.isfinite(n) and math.isfinite(k) and n > 0 and (n, k) != (1, 0)
            _require(sound, "index", self.index, "n above 0, and k, but not those of air")

    @cached_property
    def of_edges(self) -> tuple[str, ...]:
        """The effects that are given and do not go with apertures: they happen at edges, or bend
        the light, where these would have to be followed anew."""
        ideal = BenchLight()
        return tuple(name for name in REMEDIES if getattr(self, name) != getattr(ideal, name))

    @cached_property
    def on(self) -> bool:
        """Whether readings differ from those of ideal light; found once, since every call asks."""
        return replace(self, delays=(0.0, 0.0, 0.0), polarization=None) != BenchLight()


@checked
@dataclass(frozen=True)
class Imperfections:
    """What real optics do besides; for simulations, while poses are solved as if they did not.

    index: complex refractive index (n, k) of the facets' coating, None for one that reflects all.
    polarization: angle of the light's field from the beam's x axis, rad; None for unpolarised.
    wavefront_radius: of the beam at the mirror, mm, positive where it spreads.
    wavelength: of the light, mm, for diffraction at the facets' edges; 0 for none.
    sag: of each facet, mm, positive where its middle bulges out, over the diameter `sag_over`, mm.
    rolloff, rolloff_width, strips, tip, background: as in `BenchLight`, on top of what that says.
    """

    index: tuple[float, float] | None = None
    polarization: float | None = None
    wavefront_radius: float = math.inf
    wavelength: float = 0.0
    sag: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sag_over: float = 5.0
    rolloff: tuple[float, ...] = (0.0,) * 6
    rolloff_width: float = 0.0
    strips: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip: float = 0.0
    background: tuple[tuple[float, float, float], ...] = ((0.0, 0.0, 0.0),) * 3

    def __post_init__(self) -> None:
        _require(self.wavefront_radius != 0, "wavefront_radius", 0, "any but 0 mm")
        _require(self.wavelength >= 0, "wavelength", self.wavelength, "0 or more, mm")
        _require(self.sag_over > 0, "sag_over", self.sag_over, "above 0 mm")


@checked
@dataclass(frozen=True)
class Calibration:
    """How well the sensor's parameters are known, after a calibration.

    names: of parameters (`facets.PARAMETERS`) and of corrections (`correction.NAMES`).
    covariance: (n, n) as nested tuples, in mm, rad, mW and shares.
    """

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        size = len(self.names)
        square = len(self.covariance) == size and all(len(row) == size for row in self.covariance)
        _require(square, "size of the covariance", len(self.covariance), f"{size} x {size}")


def _at_thirds(kind: type[Any]) -> tuple[Any, ...]:
    return tuple(kind(azimuth=2 * pi * k / 3) for k in range(3))


@checked
@dataclass(frozen=True)
class Sensor:
    """The whole sensor. `facets` and `psds` run A, B, C.

    electronics: if given, noise follows from it instead of from `noise`.
    calibration: if given, its uncertainty is part of every pose's.
    imperfections: of the optics, in simulations alone.
    light: what the light of the bench does, in every reading.

    Seen from above the facets follow each other counter-clockwise, each within half a turn of the
    one before: else they are not the sides of a pyramid with its point up.
    """

    beam: Beam = Beam()
    facets: tuple[Facet, Facet, Facet] = _at_thirds(Facet)
    psds: tuple[Psd, Psd, Psd] = _at_thirds(Psd)
    noise: Noise = Noise()
    apertures: Apertures = Apertures()
    electronics: Electronics | None = None
    calibration: Calibration | None = None
    imperfections: Imperfections = Imperfections()
    light: BenchLight = BenchLight()

    def __post_init__(self) -> None:
        both = self.apertures.cut and self.imperfections != Imperfections()
        _require(not both, "imperfections", "given with apertures", "one of the two")
        if self.apertures.cut:
            for name in self.light.of_edges:
                _require(
                    False,
                    f"light.{name}",
                    "given with apertures",
                    f"one of the two; {REMEDIES[name]}",
                )
        for k, letter in enumerate(DETECTORS):
            following = (k + 1) % 3
            gap = (self.facets[following].azimuth - self.facets[k].azimuth) % (2 * pi)
            _require(
                0 < gap < pi,
                f"azimuth of facet {DETECTORS[following]} less that of facet {letter}",
                gap,
                "between 0 and pi rad, so that the facets make a pyramid",
            )
