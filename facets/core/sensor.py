"""The sensor: one beam, three facets, three position-sensitive detectors, and their noise.

Lengths are in mm, angles in rad, powers in mW. The defaults describe the rig of Park & Cho, Table
1. Every object is frozen and checks its values; a `Sensor` is plain data without optics.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from itertools import chain, pairwise
from math import degrees, pi
from numbers import Real
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from .arguments import check_arguments, require_plausible
from .axis_keys import HALF_TURN_MRAD, MAX_LENGTH_MM
from .errors import InputError
from .keys import FieldSource, Key, Values, declare, item_of, key, to_code
from .names import DETECTORS, TEMPERATURE_COLUMN
from .notebook import BLOCK_NAMES, changed_fields
from .units import bounds_of

Pair = tuple[float, float]
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Five = tuple[float, float, float, float, float]
Six = tuple[float, float, float, float, float, float]
Fifteen = tuple[float, float, float, float, float, float, float, float, float, float, float, float,
                float, float, float]  # fmt: skip

ANGLE_DEG: dict[str, Any] = {"ge": -360, "le": 360}
TURN_MRAD: dict[str, Any] = {"ge": -HALF_TURN_MRAD, "le": HALF_TURN_MRAD}


def _require(condition: bool, what: str, value: object, allowed: str) -> None:
    if not condition:
        raise InputError(f"{what} is {value}; allowed: {allowed}")


@cache
def _lower_bounds(kind: type[Any]) -> dict[str, tuple[float, bool, Any]]:
    """The lower bound of each field in the code's units, whether the bound itself is allowed, and
    the field's value for null, which is also allowed.

    A negative bound `ge` does not apply: it only prevents typing errors in files, and an estimate
    may be below it.
    """
    bounds = {}
    for member in fields(kind):
        source = member.metadata.get("source")
        key = source.keys[0] if source is not None else Key(member.name, None, "")
        low = key.bounds.get("gt", key.bounds.get("ge", -math.inf))
        is_limit = "gt" in key.bounds or low >= 0
        lowest = to_code(float(low), key.unit) if is_limit else -math.inf
        bounds[member.name] = lowest, "gt" not in key.bounds, key.null
    return bounds


def _are_allowed(value: object, lowest: float, with_lowest: bool) -> bool:
    """Whether all numbers in a field, which may be in nested tuples, are finite and above a bound;
    values of other types are allowed."""
    if isinstance(value, tuple):
        for item in value:  # noqa: SIM110  (a loop is faster, and a fit makes thousands of sensors)
            if not _are_allowed(item, lowest, with_lowest):
                return False
        return True
    if not isinstance(value, int | float):  # NumPy's numbers are `Real`
        return not isinstance(value, Real) or _are_allowed(float(value), lowest, with_lowest)
    return math.isfinite(value) and (value > lowest or (with_lowest and value == lowest))


class SensorPart:
    """Base of the sensor's parts; raises `InputError` for numbers that are not finite or below the
    lower bounds of their keys."""

    def __post_init__(self) -> None:
        kind: Any = type(self)
        for name, (lowest, is_allowed, null) in _lower_bounds(kind).items():
            value = getattr(self, name)
            if not (_are_allowed(value, lowest, is_allowed) or value == null):
                bound = f"{lowest:g} or more" if is_allowed else f"above {lowest:g}"
                allowed = f"finite numbers{f', {bound}' if math.isfinite(lowest) else ''}"
                _require(False, f"{name} of {kind.__name__}", value, allowed)


DIAMETER_MM = Key(
    "diameter_mm",
    (0.85, 0.85),
    "1/e^2 diameter; two for an elliptical beam, along its own axes",
    "mm",
    Pair,
    {"gt": 0, "le": 1000},
    from_single=True,
)
BEAM_TILT_MRAD = Key(
    "tilt_mrad",
    (0.0, 0.0),
    "tilt of the beam from straight down, about x_w, then about y_w",
    "mrad",
    Pair,
    {"ge": -1000, "le": 1000},
)


@check_arguments
@dataclass(frozen=True)
class Beam(SensorPart):
    """The laser beam: collimated, Gaussian, coming down onto the mirror's apex.

    Its centre (bx, by) in the x_w y_w plane is part of the state.

    power: mW.  diameter_x, diameter_y: 1/e^2 diameters along the beam's own axes, mm.
    rotation: rotation of these axes about the beam, rad.
    tilt_x, tilt_y: rotation of the beam about x_w, then y_w, from straight down (0, 0, -1), rad.
    """

    power: float = key("power_mw", 0.3, "laser power", gt=0, le=1000)
    diameter_x: float = item_of(DIAMETER_MM, 0)
    diameter_y: float = item_of(DIAMETER_MM, 1)
    rotation: float = key(
        "rotation_deg", 0.0, "rotation of the ellipse about the beam", **ANGLE_DEG
    )
    tilt_x: float = item_of(BEAM_TILT_MRAD, 0)
    tilt_y: float = item_of(BEAM_TILT_MRAD, 1)


@check_arguments
@dataclass(frozen=True)
class Facet(SensorPart):
    """One reflecting side of the mirror, through the apex, in the mirror frame.

    inclination: angle of its normal from the mirror's axis, rad, between 0 and pi/2.
    azimuth: angle of its normal about the mirror's axis, rad.
    """

    inclination: float = key(
        "inclination_deg",
        45.0,
        "angle between the facet's normal and the mirror's axis",
        gt=0,
        lt=90,
    )
    azimuth: float = key(
        "azimuth_deg",
        0.0,
        "angle of the facet's normal about the mirror's axis; 0, 120, 240 by default",
        **ANGLE_DEG,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(self.inclination < pi / 2, "facet inclination", self.inclination, "0 to pi/2 rad")


#: Exponents of y and z, in half sizes, in the terms that correct a detector's positions.
MONOMIALS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))


@check_arguments
@dataclass(frozen=True)
class Grid:
    """Measured corrections of a detector's positions on a grid, interpolated linearly, mm.

    y: (n,), z: (m,) positions, ascending.  add_y, add_z: (n, m) corrections, as nested tuples.
    """

    y: tuple[float, ...]
    z: tuple[float, ...]
    add_y: tuple[tuple[float, ...], ...]
    add_z: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        for name in ("y", "z"):
            places = getattr(self, name)
            up = len(places) > 1 and all(a < b for a, b in pairwise(places))
            _require(up, f"{name} of a grid", places, "two places or more, ascending")
        for name in ("add_y", "add_z"):
            rows = getattr(self, name)
            is_full = len(rows) == len(self.y) and all(len(row) == len(self.z) for row in rows)
            _require(is_full, f"size of {name}", len(rows), f"{len(self.y)} x {len(self.z)}")


@check_arguments
@dataclass(frozen=True)
class Correction(SensorPart):
    """Corrections that are added to a detector's reading, as functions of the position.

    power: fraction of the power that is added to it.  dark: constant added to the power, mW.  y, z:
    (9,) coefficients, mm, of `MONOMIALS` of the position in half sizes (y, z, y2, yz, z2, y3, y2z,
    yz2, z3), added to psi and zeta.  grid: measured corrections, added to both.
    """

    power: float = key(
        "power_percent", 0.0, "part of the power that is added to it", gt=-100, le=1000
    )
    dark: float = key("dark_uw", 0.0, "constant added to the power", ge=-1e6, le=1e6)
    y: tuple[float, ...] = key(
        "y_um", [0.0] * 9, "coefficients of the nine terms added to psi", length=9, ge=-1e4, le=1e4
    )
    z: tuple[float, ...] = key(
        "z_um", [0.0] * 9, "coefficients of the nine terms added to zeta", length=9, ge=-1e4, le=1e4
    )
    grid: Grid | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("y", "z"):
            count = len(getattr(self, name))
            _require(count == len(MONOMIALS), f"correction {name}", count, "9 coefficients")


#: Lowest and highest psi and zeta of an area larger than any sensitive area, mm.
EVERYWHERE = (-MAX_LENGTH_MM, MAX_LENGTH_MM) * 2

SIZE_MM = Key(
    "size_mm",
    (13.0, 13.0),
    "side of the sensitive area; two numbers for width (psi) and height (zeta)",
    "mm",
    Pair,
    {"gt": 0, "le": 1000},
    from_single=True,
)


@check_arguments
@dataclass(frozen=True)
class Psd(SensorPart):
    """A position-sensitive detector.

    radius, azimuth, height: cylindrical coordinates of its centre in the world, mm, rad, mm.
    roll, pitch, yaw: its rotation, R = Rz(yaw) Ry(pitch) Rx(roll), from the nominal orientation in
    which x points radially outward, z up and y = z cross x; rad.  size_y, size_z: sides of its
    sensitive area, mm.  usable: part of this area in which readings are used, lowest and highest
    psi and zeta, mm.  correction: of its readings.
    """

    radius: float = key(
        "radius_mm",
        250.0,
        "distance of the detector's centre from the z_w axis, R_PSD",
        gt=0,
        le=MAX_LENGTH_MM,
    )
    azimuth: float = key(
        "azimuth_deg",
        0.0,
        "angle of the detector's centre about the z_w axis; 0, 120, 240 by default",
        **ANGLE_DEG,
    )
    height: float = key(
        "height_mm",
        0.0,
        "height of the detector's centre above the x_w y_w plane",
        ge=-MAX_LENGTH_MM,
        le=MAX_LENGTH_MM,
    )
    roll: float = key("roll_mrad", 0.0, "rotation about the detector's normal", **TURN_MRAD)
    pitch: float = key(
        "pitch_mrad", 0.0, "rotation about the detector's horizontal axis y, psi", **TURN_MRAD
    )
    yaw: float = key(
        "yaw_mrad", 0.0, "rotation about the detector's upright axis z, zeta", **TURN_MRAD
    )
    size_y: float = item_of(SIZE_MM, 0)
    size_z: float = item_of(SIZE_MM, 1)
    usable: tuple[float, ...] = key(
        "usable_mm",
        None,
        "part of the sensitive area in which readings are used, lowest and highest psi and zeta; "
        "spots outside it are out of range; null: all of it",
        hint=tuple[float, float, float, float] | None,
        ge=-MAX_LENGTH_MM,
        le=MAX_LENGTH_MM,
        null=EVERYWHERE,
    )
    correction: Correction = Correction()

    def __post_init__(self) -> None:
        super().__post_init__()
        ascends = self.usable[0] < self.usable[1] and self.usable[2] < self.usable[3]
        _require(
            ascends, "PSD usable_mm", self.usable, "lowest psi below highest, and zeta likewise"
        )

    def limit(self, axis: int, low: float, high: float) -> Psd:
        """Return the detector with its usable part limited to an interval, mm, of one axis.

        axis: 0 for psi, 1 for zeta.
        """
        ends = list(self.usable)
        ends[2 * axis : 2 * axis + 2] = max(ends[2 * axis], low), min(ends[2 * axis + 1], high)
        return replace(self, usable=tuple(ends))


@check_arguments
@dataclass(frozen=True)
class Noise(SensorPart):
    """Noise of the readings, 1 sigma.

    It is Gaussian, and independent between readings.

    position: of a centroid, mm, at the power `at_power`, mW; it is proportional to 1/power.
    power: of a power reading, mW.
    """

    position: float = key(
        "position_um", 2.6, "noise of a centroid at the power `at_power_mw`", gt=0, le=1000
    )
    at_power: float = key(
        "at_power_mw",
        0.1,
        "power on the detector at which `position_um` holds",
        gt=0,
        le=1000,
    )
    power: float = key("power_uw", 0.04, "noise of a power reading", gt=0, le=1000)


@check_arguments
@dataclass(frozen=True)
class Electronics(SensorPart):
    """The detectors' electronics, which determine the noise if `noise.model` is electronics.

    `facets.detectors.noise` computes the noise.

    kind: of the PSDs: "duo-lateral", "pincushion" or "tetra-lateral".  responsivity: A/W.
    dark_current: of a PSD, A.  resistance: between electrodes, ohm.  transimpedance: of each
    electrode's amplifier, ohm (V/A); voltage_noise, current_noise: of the amplifier, V and A per
    root Hz.  bandwidth: Hz.  temperature: K.  adc_bits: resolution of the converter.  adc_range:
    its full scale, V.  ambient: background light on a PSD, mW; its mean is subtracted, its noise
    remains.  power_noise: relative noise of the laser's power between samples.  pointing: jitter
    of the beam's position in x and y, mm.
    """

    kind: Literal["duo-lateral", "pincushion", "tetra-lateral"] = key(
        "kind", "duo-lateral", "how the PSDs divide their current among the electrodes"
    )
    responsivity: float = key(
        "responsivity_a_w", 0.4, "photocurrent per power of the light", gt=0, le=10
    )
    dark_current: float = key("dark_current_na", 10.0, "dark current of a PSD", ge=0, le=1e6)
    resistance: float = key(
        "resistance_kohm", 10.0, "resistance between opposite electrodes", gt=0, le=1e6
    )
    transimpedance: float = key(
        "transimpedance_kohm",
        100.0,
        "transimpedance gain of each electrode's amplifier: volts per ampere",
        gt=0,
        le=1e9,
    )
    voltage_noise: float = key(
        "voltage_noise_nv_rthz", 10.0, "voltage noise of each amplifier", ge=0, le=1e6
    )
    current_noise: float = key(
        "current_noise_pa_rthz", 1.0, "current noise of each amplifier", ge=0, le=1e6
    )
    bandwidth: float = key("bandwidth_hz", 10_000.0, "bandwidth of a reading", gt=0, le=1e9)
    temperature: float = key(
        "temperature_k",
        296.0,
        "temperature of detectors and amplifiers",
        **bounds_of("temperature_k"),
    )
    adc_bits: int = key(
        "adc_bits", 16, "resolution of the analogue-to-digital converter", ge=1, le=32
    )
    adc_range: float = key(
        "adc_range_v", 10.0, "full-scale range of the analogue-to-digital converter", gt=0, le=1000
    )
    ambient: float = key(
        "ambient_uw",
        0.0,
        "power of background light on a PSD; its mean is subtracted, its noise stays",
        ge=0,
        le=1e6,
    )
    power_noise: float = key(
        "power_noise_ppm", 0.0, "noise of the laser's power from reading to reading", ge=0, le=1e6
    )
    pointing: float = key(
        "pointing_um",
        0.0,
        "noise of the beam's position in x and in y from reading to reading",
        ge=0,
        le=1e4,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(self.adc_bits <= 32, "adc_bits", self.adc_bits, "1 to 32")


@check_arguments
@dataclass(frozen=True)
class Apertures(SensorPart):
    """Apertures that cut the light, in addition to the facets' edges; off by default.

    beam: diameter of an aperture in the beam over the beam's 1/e^2 diameter; it has the beam's
    shape and centre, so that 1 cuts where the irradiance has fallen to 1/e^2.  detectors: whether
    light past a PSD's sensitive area is lost. The solver then treats a spot that an edge cuts as
    out of range, because its centroid hardly moves.  tip, rim: distances from the mirror's axis,
    along each facet's azimuth, between which the facets reflect, mm; straight edges bound the flat
    tip and the foot.  gap: width of the strip that is lost along each edge, half of it on either
    facet, mm.
    """

    beam: float = key(
        "beam_ratio",
        None,
        "diameter of an aperture in the beam over its 1/e^2 diameter; 1 as the paper",
        gt=0,
        le=100,
        null=math.inf,
    )
    detectors: bool = key(
        "detectors",
        False,
        "whether light past a PSD's sensitive area is lost; the solver then treats a spot that an "
        "edge cuts as out of range",
    )
    tip: float = key(
        "tip_um",
        0.0,
        "distance from the mirror's axis at which the facets begin: a flat tip",
        ge=0,
        le=10_000,
    )
    rim: float = key(
        "rim_mm",
        None,
        "distance from the mirror's axis at which the facets end at the foot; null: no rim",
        gt=0,
        le=1000,
        null=math.inf,
    )
    gap: float = key(
        "gap_um", 0.0, "width of the strip along each edge that reflects nothing", ge=0, le=10_000
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(self.rim > self.tip, "mirror rim", self.rim, "above its tip, mm")

    @property
    def cut(self) -> bool:
        """Whether any aperture cuts the light."""
        return self != Apertures()


#: The ends of facets at edges, in the order of `BenchLight.rolloff`: facet by facet, first edge and
#: second edge, counter-clockwise seen from above.
FACET_EDGES = ("edge_ca_a", "edge_ab_a", "edge_ab_b", "edge_bc_b", "edge_bc_c", "edge_ca_c")
#: The mirror's edges in the order of `BenchLight.strips`: facet k begins at edge number k.
EDGES = ("ca", "ab", "bc")
#: Orders along x and y of the Hermite polynomials of `BenchLight.stains`.
STAIN_ORDERS = tuple((a, n - a) for n in range(5) for a in range(n + 1))


class LightEffect(NamedTuple):
    """Properties of a field of `BenchLight` for the model and calibrations, except its formula.

    names: names of the field's numbers in a calibration, in order.
    candidate: the key of `LIGHT_CANDIDATES` to which the numbers belong.
    sigma: standard uncertainties before a calibration, in the code's units, one for all numbers or
    one for each; 0 for a number that is not fitted.
    apertures: why the effect cannot be combined with apertures, or a remedy; empty if it can.
    absent: the numbers if the field is None.
    """

    names: tuple[str, ...]
    candidate: str
    sigma: float | tuple[float, ...]
    apertures: str = ""
    absent: tuple[float, ...] = ()

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard uncertainties before a calibration of the numbers that are fitted, by name."""
        sizes = self.sigma if isinstance(self.sigma, tuple) else (self.sigma,) * len(self.names)
        return {name: size for name, size in zip(self.names, sizes, strict=True) if size}


#: Effects of a bench's light that a calibration tries, in this order: for each key of
#: `calibrate.effects` its meaning, and a noun phrase for messages.
LIGHT_CANDIDATES = {
    "curvature": ("curvature of the wavefront, along two axes", "a wavefront that is not flat"),
    "diffraction": ("diffraction at the facets' edges", "diffraction at the facets' edges"),
    "rolloff": ("roll-off of the facets at their edges", "edges that are rolled off"),
    "strips": (
        "strips along the facets' edges that reflect nothing", "strips lost along the edges"
    ),
    "tip": ("worn tip of the mirror, which reflects nothing", "a tip worn flat"),
    "background": ("background light on the detectors", "background light on the detectors"),
    "coating": (
        "reflectance that depends on incidence and polarisation",
        "a coating's reflectance, and polarised light",
    ),
    "profile": ("deviation of the beam's profile from a Gaussian", "a beam that is not Gaussian"),
    "asymmetry": ("asymmetry of the beam's profile", "a beam that is not symmetric"),
    "stains": ("light that dust, chips and stains take from each facet", "stains on the facets"),
}  # fmt: skip
CURVATURE: dict[str, Any] = {
    "candidate": "curvature",
    "sigma": 1e-3,
    "apertures": "light that is cut is modelled as collimated only",
}


def declare_effect(field: Any, *names: str, **effect: Any) -> Any:
    """Declare a field of `BenchLight` with its `LightEffect`."""
    effect_of_field = LightEffect(names, **effect)
    field.metadata = MappingProxyType({**field.metadata, "effect": effect_of_field})
    return field


CURVATURE_PER_M = Key(
    "curvature_per_m",
    (0.0, 0.0, 0.0),
    "curvature of the wavefront, one over its radius: xx, xy, yy along x_w and y_w; positive for "
    "a diverging beam",
    "per_m",
    Three,
    {"ge": -1e3, "le": 1e3},
)


#: Distance from the beam's centre, in its sigmas, within which the irradiance must be positive.
#: Farther out, where there is hardly any light, a series of few terms may become negative.
PROFILE_SIGMAS = 2.0


def lowest_irradiance(asymmetry: Four, profile: Five) -> float:
    """The least irradiance within PROFILE_SIGMAS, as a ratio to a Gaussian beam's irradiance.

    asymmetry, profile: coefficients as in `BenchLight`.
    """
    lowest = math.inf
    for n in range(32):
        for m in range(17):
            radius = PROFILE_SIGMAS * m / 16
            x, y = radius * math.cos(pi * n / 16), radius * math.sin(pi * n / 16)
            he_x, he_y = ((1.0, t, t * t - 1, t**3 - 3 * t, t**4 - 6 * t * t + 3) for t in (x, y))
            odd = (c * he_x[3 - k] * he_y[k] for k, c in enumerate(asymmetry))
            even = (c * he_x[4 - k] * he_y[k] for k, c in enumerate(profile))
            lowest = min(lowest, 1 + sum(odd) + sum(even))
    return lowest


def background_field() -> Any:
    """Declare one field for background light on the detectors, with keys for power and position."""
    keys = (
        Key(
            "background_uw",
            (0.0,) * 3,
            "power of background light on detectors A, B and C",
            "uw",
            Three,
            {"ge": -1e6, "le": 1e6},
        ),
        Key(
            "background_mm",
            ((0.0, 0.0),) * 3,
            "psi and zeta of the background light's centroid on each detector",
            "mm",
            tuple[Pair, Pair, Pair],
            {"ge": -1e3, "le": 1e3},
        ),
    )

    def read(values: Values) -> tuple[Three, ...]:
        powers, places = (part.read(values[part.name]) for part in keys)
        return tuple((power, *place) for power, place in zip(powers, places, strict=True))

    def write(rows: tuple[Three, ...]) -> list[Any]:
        return [keys[0].write([row[0] for row in rows]), keys[1].write([row[1:] for row in rows])]

    return declare(FieldSource(keys, read, write=write))


@check_arguments
@dataclass(frozen=True)
class BenchLight(SensorPart):
    """Effects of real light that the model of every reading includes; off by default.

    curvature_xx, curvature_xy, curvature_yy: curvature of the wavefront at (bx, by, 0), 1/mm, the
    inverse of its radius, positive if the beam diverges. The axes x and y are the world's, rotated
    with the beam's tilt but not with its ellipse.  wavelength: for the diffraction at the facets'
    edges, mm; 0: no diffraction.  rolloff: (6,) depth of the surface below its facet's plane at
    each of `FACET_EDGES`, mm.  rolloff_width: width of the strip over which the surface falls
    linearly, mm, narrow compared with the beam.  strips: (3,) width of the strip that is lost along
    each of `EDGES`, half of it on either facet, mm.  tip: area, perpendicular to the mirror's axis,
    that is lost at a worn apex, mm^2.

    background: background light on detectors A, B and C: power, mW, and its centroid's psi and
    zeta, mm.  index: complex refractive index (n, k) of the facets' coating; None: ideal
    reflection.  polarization: angle of the light's field from the x axis of the curvature, rad;
    None: unpolarised.  delays: delays of detectors A, B and C after a sample's stated time, s. They
    affect recordings, not single readings (`facets.detectors.skew`).

    profile: coefficients of He_4(x), He_3(x) He_1(y), He_2(x) He_2(y), He_1(x) He_3(y) and He_4(y).
    The Gaussian irradiance is multiplied by 1 plus the sum of these Hermite polynomials of x and y,
    in units of the beam's sigma.  asymmetry: coefficients of He_3(x), He_2(x) He_1(y), He_1(x)
    He_2(y) and He_3(y), likewise.  stains: for each facet, coefficients of the light that dust,
    chips and stains take from it, as fractions of the beam's power; see `optics.stains`.
    """

    curvature_xx: float = declare_effect(
        item_of(CURVATURE_PER_M, 0), "light.curvature_xx", **CURVATURE
    )
    curvature_xy: float = declare_effect(
        item_of(CURVATURE_PER_M, 1), "light.curvature_xy", **CURVATURE
    )
    curvature_yy: float = declare_effect(
        item_of(CURVATURE_PER_M, 2), "light.curvature_yy", **CURVATURE
    )
    wavelength: float = declare_effect(
        key(
            "wavelength_nm",
            None,
            "wavelength of the light, for diffraction at edges; null: no diffraction",
            gt=0,
            le=20_000,
            null=0.0,
        ),
        "light.wavelength",
        candidate="diffraction",
        sigma=1e-3,
        apertures="an aperture's own edge would diffract too, which is not modelled",
    )
    rolloff: Six = declare_effect(
        key(
            "rolloff_nm",
            (0.0,) * 6,
            "depth by which a facet falls off at an edge: of a at ca and ab, of b at ab "
            "and bc, of c at bc and ca",
            ge=-1e5,
            le=1e5,
        ),
        *(f"{edge}.rolloff" for edge in FACET_EDGES),
        candidate="rolloff",
        sigma=3e-4,
        apertures="the light along an edge that is cut short is not modelled",
    )
    rolloff_width: float = declare_effect(
        key(
            "rolloff_width_um",
            0.0,
            "width of the strip over which a facet falls off, inside a strip that reflects nothing",
            ge=0,
            le=1000,
        ),
        "rolloff.width",
        candidate="rolloff",
        sigma=0.05,
    )
    strips: Three = declare_effect(
        key(
            "strips_um",
            (0.0, 0.0, 0.0),
            "width of the strips along the edges ca, ab, bc that reflect nothing",
            ge=-1e3,
            le=1e3,
        ),
        *(f"strip_{edge}.width" for edge in EDGES),
        candidate="strips",
        sigma=0.03,
        apertures="for strips of one width along all edges give apertures.gap_um alone",
    )
    tip: float = declare_effect(
        key(
            "tip_um2",
            0.0,
            "area of a worn tip that reflects nothing, in addition to the strips",
            ge=-1e6,
            le=1e6,
        ),
        "tip.area",
        candidate="tip",
        sigma=0.01,
        apertures="for a flat tip give apertures.tip_um alone",
    )
    background: tuple[Three, Three, Three] = declare_effect(
        background_field(),
        *(f"background_{letter}.{what}" for letter in DETECTORS for what in ("power", "y", "z")),
        candidate="background",
        sigma=(3e-3, 3.0, 3.0) * 3,  # mW, and anywhere on the sensitive area, mm
    )
    index: Pair | None = declare_effect(
        key(
            "index",
            None,
            "complex refractive index n, k of the coating; null: ideal reflection",
            ge=0,
            le=100,
        ),
        "coating.n",
        "coating.k",
        candidate="coating",
        sigma=0.0,
        absent=(1.0, 0.0),
    )
    polarization: float | None = declare_effect(
        key(
            "polarization_deg",
            None,
            "angle of the light's polarisation from the beam's x axis; null: unpolarised",
            unit="deg_of_phase",
            **ANGLE_DEG,
        ),
        "light.polarization",
        candidate="coating",
        sigma=1.0,
        absent=(0.0,),
    )
    delays: Three = key(
        "delays_us",
        (0.0, 0.0, 0.0),
        "delay of detectors A, B and C after the stated time of a sample",
        ge=-1e6,
        le=1e6,
    )
    profile: Five = declare_effect(
        key(
            "profile",
            (0.0,) * 5,
            "deviation of the beam's profile from a Gaussian: coefficients of the Hermite "
            "polynomials of fourth order xxxx, xxxy, xxyy, xyyy, yyyy along x_w and y_w",
            ge=-1,
            le=1,
        ),
        *(f"profile.{axes}" for axes in ("xxxx", "xxxy", "xxyy", "xyyy", "yyyy")),
        candidate="profile",
        sigma=0.02,
        apertures="light that is cut is modelled as Gaussian only",
    )
    asymmetry: Four = declare_effect(
        key(
            "asymmetry",
            (0.0,) * 4,
            "asymmetric deviation of the beam's profile from a Gaussian: coefficients of the "
            "Hermite polynomials of third order xxx, xxy, xyy, yyy along x_w and y_w",
            ge=-1,
            le=1,
        ),
        *(f"asymmetry.{axes}" for axes in ("xxx", "xxy", "xyy", "yyy")),
        candidate="asymmetry",
        sigma=0.02,
        apertures="light that is cut is modelled as Gaussian only",
    )
    stains: tuple[Fifteen, Fifteen, Fifteen] = declare_effect(
        key(
            "stains",
            ((0.0,) * 15,) * 3,
            "light that dust, chips and stains take from facets A, B and C: coefficients of the "
            "normalised Hermite polynomials 1, y, x, yy, xy, xx, ... up to fourth order",
            ge=-1,
            le=1,
        ),
        *(f"stain_{letter}.{a}{b}" for letter in DETECTORS for a, b in STAIN_ORDERS),
        candidate="stains",
        sigma=3e-3,
        apertures="light that is cut is modelled without stains",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.index is not None:
            _require(
                self.index[0] > 0 and self.index != (1, 0),
                "index",
                self.index,
                "n above 0, and k, but not those of air",
            )
        if self.has_profile:
            lowest = lowest_irradiance(self.asymmetry, self.profile)
            allowed = f"coefficients that leave light everywhere within {PROFILE_SIGMAS:g} sigma"
            _require(lowest > 0, "profile", (*self.profile, *self.asymmetry), allowed)

    @property
    def has_profile(self) -> bool:
        """Whether the beam's profile is not Gaussian, or stains take light from the facets."""
        return any((*self.profile, *self.asymmetry, *chain(*self.stains)))

    @cached_property
    def edge_effects(self) -> tuple[str, ...]:
        """Names of the effects that are on but cannot be combined with apertures: effects at edges,
        of the wavefront and of the profile."""
        ideal = BenchLight()
        return tuple(
            name
            for name, effect in LIGHT_EFFECTS.items()
            if effect.apertures and getattr(self, name) != getattr(ideal, name)
        )

    @cached_property
    def on(self) -> bool:
        """Whether readings differ from readings in ideal light; cached, because every call of the
        model needs it."""
        return replace(self, delays=(0.0, 0.0, 0.0), polarization=None) != BenchLight()


#: The effects of light by the field of `BenchLight`, and the names of their numbers.
LIGHT_EFFECTS: dict[str, LightEffect] = {
    field.name: field.metadata["effect"]
    for field in fields(BenchLight)
    if "effect" in field.metadata
}
EFFECTS = tuple(name for effect in LIGHT_EFFECTS.values() for name in effect.names)


@check_arguments
@dataclass(frozen=True)
class Thermal(SensorPart):
    """Temperature coefficients of the beam's position and of the positions on the detectors.

    reference: temperature without a shift, degrees Celsius.  beam: shift of the beam's position in
    x and y, mm/K.  places: (6,) shift of psi and zeta of detectors A, B and C, mm/K.
    """

    reference: float = key(
        "reference_c",
        20.0,
        "temperature without a shift",
        **bounds_of(TEMPERATURE_COLUMN),
    )
    beam: Pair = key(
        "beam_um_per_k", (0.0, 0.0), "shift of the beam's position in x and y", ge=-1e4, le=1e4
    )
    places: tuple[float, ...] = key(
        "places_um_per_k",
        [0.0] * 6,
        "shift of the readings psi and zeta of detector A, then B, then C",
        length=6,
        ge=-1e4,
        le=1e4,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(len(self.places) == 6, "thermal places", len(self.places), "6 coefficients")
        require_plausible(self.reference, TEMPERATURE_COLUMN, "the reference temperature")

    @property
    def is_on(self) -> bool:
        """Whether any coefficient is not zero."""
        return any((*self.beam, *self.places))


@check_arguments
@dataclass(frozen=True)
class Drift(SensorPart):
    """Slow noise in addition to the white noise of the readings: one-sided densities at 1 Hz.

    flicker_corner: frequency at which the 1/f noise of the amplifiers equals their white noise, Hz;
    used with `Sensor.electronics`.  air: of psi and zeta of each spot, mm/sqrt(Hz), proportional to
    1/sqrt(f).  pointing: of the beam's position in x and in y, mm/sqrt(Hz), proportional to 1/f (a
    random walk).  temperature: K/sqrt(Hz), proportional to 1/f; `Thermal` has its effect on the
    beam and the positions.
    """

    flicker_corner: float = key(
        "flicker_corner_hz",
        0.0,
        "frequency at which the amplifiers' 1/f noise equals their white noise",
        ge=0,
        le=1e6,
    )
    air: float = key(
        "air_nm_rthz",
        0.0,
        "noise of each spot's place by the air, nm/sqrt(Hz) at 1 Hz, falling as 1/sqrt(f)",
        ge=0,
        le=1e9,
    )
    pointing: float = key(
        "pointing_nm_rthz",
        0.0,
        "random walk of the beam's position in x and in y, nm/sqrt(Hz) at 1 Hz, falling as 1/f",
        ge=0,
        le=1e9,
    )
    temperature: float = key(
        "temperature_mk_rthz",
        0.0,
        "random walk of the temperature, mK/sqrt(Hz) at 1 Hz, falling as 1/f; the coefficients of "
        "`sensor.temperature` carry it to the beam and the places",
        ge=0,
        le=1e6,
    )


@check_arguments
@dataclass(frozen=True)
class Calibration:
    """The covariance of the sensor's parameters after a calibration.

    names: (n,) names of parameters (`detectors.calibrated.KNOWN`).  covariance: (n, n) as nested
    tuples, in mm, rad, mW and fractions.  degrees_of_freedom: of the residuals by which the
    covariance was scaled; None: unknown.
    """

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    degrees_of_freedom: float | None = None

    def __post_init__(self) -> None:
        size = len(self.names)
        square = len(self.covariance) == size and all(len(row) == size for row in self.covariance)
        _require(square, "size of the covariance", len(self.covariance), f"{size} x {size}")
        freedom = self.degrees_of_freedom
        _require(freedom is None or freedom > 0, "degrees of freedom", freedom, "above 0, or None")


def _equal_thirds(kind: type[Any]) -> tuple[Any, ...]:
    return tuple(kind(azimuth=2 * pi * k / 3) for k in range(3))


@check_arguments
@dataclass(frozen=True)
class Sensor:
    """The sensor: beam, mirror and detectors. `facets` and `psds` are in the order A, B, C.

    electronics: determine the noise, instead of `noise`, if not None.  calibration: covariance of
    the parameters, which is part of every pose's uncertainty, if not None.  light: effects in the
    model of every reading.  thermal: temperature coefficients, for readings with a temperature.
    drift: slow noise, in simulations and in stated densities.

    Seen from above the facets follow each other counter-clockwise, each less than half a turn from
    the previous one; otherwise they do not form a pyramid, and `InputError` is raised.
    """

    beam: Beam = Beam()
    facets: tuple[Facet, Facet, Facet] = _equal_thirds(Facet)
    psds: tuple[Psd, Psd, Psd] = _equal_thirds(Psd)
    noise: Noise = Noise()
    apertures: Apertures = Apertures()
    electronics: Electronics | None = None
    calibration: Calibration | None = None
    light: BenchLight = BenchLight()
    thermal: Thermal = Thermal()
    drift: Drift = Drift()

    def __post_init__(self) -> None:
        if self.apertures.cut:
            for name in self.light.edge_effects:
                _require(
                    False,
                    f"light.{name}",
                    "given with apertures",
                    f"one of the two; {LIGHT_EFFECTS[name].apertures}",
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

    @property
    def summary(self) -> str:
        """Beam, facets and detectors, and the blocks of keys that differ from the paper's sensor;
        the values of different parts are separated by slashes."""
        beam = self.beam
        diameter = " x ".join(f"{size:g}" for size in {beam.diameter_x: 0, beam.diameter_y: 0})
        numbers = (
            {f"{degrees(facet.inclination):.6g}": 0 for facet in self.facets},
            {f"{psd.size_y:g} x {psd.size_z:g}": 0 for psd in self.psds},
            {f"{psd.radius:g}": 0 for psd in self.psds},
        )
        inclination, size, radius = map("/".join, numbers)
        blocks = [BLOCK_NAMES.get(name, name) for name, *_ in changed_fields(self)]
        others = f"; differs from the paper's in {', '.join(blocks)}" if blocks else ""
        return (
            f"{beam.power:g} mW, beam {diameter} mm, facets {inclination} deg, PSDs {size} mm at "
            f"{radius} mm{others}"
        )
