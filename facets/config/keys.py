"""The keys of a configuration file outside `motions`: unit, default, range and meaning of each.

Defaults are the rig of Park & Cho, Table 1; R_PSD, lost there, follows from the ranges of Table 2.
A key's last part is its unit. The checks are strict: text and true/false are no numbers.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Union

from pydantic import BeforeValidator, ConfigDict, Field, create_model

from ..core.axis_keys import HALF_TURN_MRAD as HALF_TURN
from ..core.axis_keys import MAX_LENGTH_MM as MAX_LENGTH
from ..core.keys import block_of
from ..core.motions import KINDS
from ..core.settings import Config
from .models import NAME, StrictModel, field_of, model_of, none_to_block, type_of
from .models import StrictModel as Section
from .models import list_to_tuple as as_tuple


def _pair(value: Any) -> Any:
    """One number stands for two equal ones; YAML's list becomes a tuple."""
    return tuple(value) if isinstance(value, list) else (value, value)


Length = Annotated[float, Field(gt=0, le=1000)]
Lengths = Annotated[
    tuple[Length, Length],
    BeforeValidator(_pair, json_schema_input_type=Length | tuple[Length, Length]),
]
Tilt = Annotated[float, Field(ge=-1000, le=1000)]
Tilts = Annotated[
    tuple[Tilt, Tilt], BeforeValidator(as_tuple, json_schema_input_type=tuple[Tilt, Tilt])
]


class Beam(Section):
    """The laser beam: collimated, Gaussian, coming down onto the mirror's apex."""

    power_mw: float = Field(0.3, gt=0, le=1000, description="laser power")
    diameter_mm: Lengths = Field(
        (0.85, 0.85), description="1/e^2 diameter; two for an elliptical beam, along its own axes"
    )
    rotation_deg: float = Field(
        0.0, ge=-360, le=360, description="turn of the ellipse about the beam"
    )
    tilt_mrad: Tilts = Field(
        (0.0, 0.0), description="of the beam from straight down, about x_w, then about y_w"
    )


class FacetShape(Section):
    inclination_deg: float = Field(
        45.0, gt=0, lt=90, description="of the facet's normal from the mirror's axis"
    )


def _no_defaults(schema: dict[str, Any]) -> None:
    """What a single detector leaves out is taken from the common keys, not from a constant."""
    for entry in schema["properties"].values():
        entry.pop("default", None)


class OneFacet(FacetShape):
    """One facet; a key left out takes the value common to the three."""

    model_config = ConfigDict(json_schema_extra=_no_defaults)

    azimuth_deg: float = Field(
        0.0,
        ge=-360,
        le=360,
        description="of the facet's normal about the mirror's axis; if left out 0, 120, 240",
    )


class Mirror(FacetShape):
    """The three facets, counter-clockwise seen from above; common keys, then single ones."""

    a: OneFacet = Field(OneFacet(), description="facet a alone")
    b: OneFacet = Field(OneFacet(), description="facet b alone")
    c: OneFacet = Field(OneFacet(), description="facet c alone")


NINE = Annotated[list[Annotated[float, Field(ge=-1e4, le=1e4)]], Field(min_length=9, max_length=9)]


class CorrectionKeys(Section):
    """What is added to what a detector reads: y, z, y2, yz, z2, y3, y2z, yz2, z3 in half sizes."""

    power_percent: float = Field(0.0, gt=-100, le=1000, description="added to the power")
    dark_uw: float = Field(0.0, ge=-1e6, le=1e6, description="added to the power besides")
    y_um: NINE = Field([0.0] * 9, description="added to psi, times each of the nine")
    z_um: NINE = Field([0.0] * 9, description="added to zeta, times each of the nine")
    table: str | None = Field(
        None, description="CSV file, path from this file: psi_mm, zeta_mm, add_psi_um, add_zeta_um"
    )
    table_sha256: str | None = Field(None, pattern="^[0-9a-f]{64}$", description="of that file")


class PsdShape(Section):
    radius_mm: float = Field(
        250.0, gt=0, le=MAX_LENGTH, description="of the centre from the z_w axis, R_PSD"
    )
    height_mm: float = Field(
        0.0, ge=-MAX_LENGTH, le=MAX_LENGTH, description="of the centre above the x_w y_w plane"
    )
    roll_mrad: float = Field(
        0.0, ge=-HALF_TURN, le=HALF_TURN, description="turn about the detector's normal"
    )
    pitch_mrad: float = Field(
        0.0, ge=-HALF_TURN, le=HALF_TURN, description="turn about its horizontal axis y, psi"
    )
    yaw_mrad: float = Field(
        0.0, ge=-HALF_TURN, le=HALF_TURN, description="turn about its upright axis z, zeta"
    )
    size_mm: Lengths = Field(
        (13.0, 13.0), description="of the sensitive area; two for width (psi) and height (zeta)"
    )
    correction: CorrectionKeys = Field(
        CorrectionKeys(), description="of what it reads; a calibration's"
    )


class OnePsd(PsdShape):
    """One detector; a key left out takes the value common to the three."""

    model_config = ConfigDict(json_schema_extra=_no_defaults)

    azimuth_deg: float = Field(
        0.0,
        ge=-360,
        le=360,
        description="of the centre about the z_w axis; if left out 0, 120, 240",
    )


class Psds(PsdShape):
    """The three position-sensitive detectors; common keys, then single ones."""

    a: OnePsd = Field(OnePsd(), description="PSD a alone")
    b: OnePsd = Field(OnePsd(), description="PSD b alone")
    c: OnePsd = Field(OnePsd(), description="PSD c alone")


class Noise(Section):
    """Noise of the readings, 1 sigma."""

    model: Literal["simple", "electronics"] = Field(
        "simple", description="noise by the numbers here, or from the block `electronics`"
    )
    position_um: float = Field(2.6, gt=0, le=1000, description="of a centroid, at `at_power_mw`")
    at_power_mw: float = Field(
        0.1, gt=0, le=1000, description="power on the detector at which `position_um` holds"
    )
    power_uw: float = Field(0.04, gt=0, le=1000, description="of a power reading")


class Electronics(Section):
    """The detectors' electronics; their noise counts where `noise.model` is electronics."""

    kind: Literal["duo-lateral", "pincushion", "tetra-lateral"] = Field(
        "duo-lateral", description="how the PSDs divide their current among the electrodes"
    )
    responsivity_a_w: float = Field(0.4, gt=0, le=10, description="current per light")
    dark_current_na: float = Field(10.0, ge=0, le=1e6, description="of a PSD")
    resistance_kohm: float = Field(10.0, gt=0, le=1e6, description="between electrodes")
    transimpedance_kohm: float = Field(
        100.0, gt=0, le=1e9, description="of an electrode's amplifier: volts per ampere"
    )
    voltage_noise_nv_rthz: float = Field(10.0, ge=0, le=1e6, description="of the amplifier")
    current_noise_pa_rthz: float = Field(1.0, ge=0, le=1e6, description="of the amplifier")
    bandwidth_hz: float = Field(10_000.0, gt=0, le=1e9, description="of a reading")
    temperature_k: float = Field(296.0, ge=0, le=1000, description="of detectors and amplifiers")
    adc_bits: int = Field(16, ge=1, le=32, description="of the converter")
    adc_range_v: float = Field(10.0, gt=0, le=1000, description="of the converter, full scale")
    ambient_uw: float = Field(
        0.0, ge=0, le=1e6, description="other light on a PSD; its mean is taken off"
    )
    power_noise_ppm: float = Field(
        0.0, ge=0, le=1e6, description="of the laser's power, from reading to reading"
    )
    pointing_um: float = Field(
        0.0, ge=0, le=1e4, description="of the beam's place in x and y, from reading to reading"
    )


class Apertures(Section):
    """What cuts the light, beside the facets' edges; off unless given."""

    beam_ratio: float | None = Field(
        None,
        gt=0,
        le=100,
        description="diameter of an aperture in the beam over its 1/e^2 diameter; 1 as the paper",
    )
    detectors: bool = Field(
        False,
        description="whether light past a PSD's sensitive area is lost; a spot that is cut is then "
        "out of range for the solver",
    )
    rim_mm: float | None = Field(
        None, gt=0, le=1000, description="where the facets end below, from the mirror's axis"
    )
    tip_um: float = Field(
        0.0, ge=0, le=10_000, description="where the facets begin, from the axis: a flat tip"
    )
    gap_um: float = Field(
        0.0, ge=0, le=10_000, description="width of the strip that is lost along each edge"
    )


Index = Annotated[float, Field(ge=0, le=100)]
Sag = Annotated[float, Field(ge=-10_000, le=10_000)]


Curvature = Annotated[float, Field(ge=-1e3, le=1e3)]
Nanometres = Annotated[float, Field(ge=-1e5, le=1e5)]
Micrometres = Annotated[float, Field(ge=-1e3, le=1e3)]
Microwatts = Annotated[float, Field(ge=-1e6, le=1e6)]
Millimetres = Annotated[float, Field(ge=-1e3, le=1e3)]
Microseconds = Annotated[float, Field(ge=-1e6, le=1e6)]


Curvatures = Annotated[tuple[Curvature, Curvature, Curvature], BeforeValidator(as_tuple)]
Depths = Annotated[
    tuple[Nanometres, Nanometres, Nanometres, Nanometres, Nanometres, Nanometres],
    BeforeValidator(as_tuple),
]
Widths = Annotated[tuple[Micrometres, Micrometres, Micrometres], BeforeValidator(as_tuple)]
Strip = Annotated[float, Field(ge=0, le=1e3)]
Strips = Annotated[tuple[Strip, Strip, Strip], BeforeValidator(as_tuple)]
Powers = Annotated[tuple[Microwatts, Microwatts, Microwatts], BeforeValidator(as_tuple)]
Place = Annotated[tuple[Millimetres, Millimetres], BeforeValidator(as_tuple)]
Places = Annotated[tuple[Place, Place, Place], BeforeValidator(as_tuple)]
Delays = Annotated[tuple[Microseconds, Microseconds, Microseconds], BeforeValidator(as_tuple)]


class Imperfections(Section):
    """What real optics do besides: simulated, and solved as if it were not there."""

    index: Annotated[tuple[Index, Index], BeforeValidator(as_tuple)] | None = Field(
        None, description="complex refractive index n, k of the coating; null reflects all"
    )
    polarization_deg: float | None = Field(
        None, ge=-360, le=360, description="of the light, from the beam's x axis; null is none"
    )
    wavefront_radius_mm: float | None = Field(
        None, ge=-1e9, le=1e9, description="of the beam at the mirror, positive where it spreads"
    )
    wavelength_nm: float | None = Field(
        None, gt=0, le=20_000, description="of the light, for diffraction at edges; null for none"
    )
    sag_nm: Annotated[tuple[Sag, Sag, Sag], BeforeValidator(as_tuple)] = Field(
        (0.0, 0.0, 0.0), description="by which facets A, B, C bulge, over `sag_over_mm`"
    )
    sag_over_mm: float = Field(5.0, gt=0, le=1000, description="diameter of a facet")
    rolloff_nm: Depths = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), description="as in `light`, on top of what that says"
    )
    rolloff_width_um: float = Field(0.0, ge=0, le=1000, description="likewise")
    strips_um: Strips = Field((0.0, 0.0, 0.0), description="likewise")
    tip_um2: float = Field(0.0, ge=0, le=1e6, description="likewise")
    background_uw: Powers = Field((0.0, 0.0, 0.0), description="likewise")
    background_mm: Places = Field(((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)), description="likewise")


class LightKeys(Section):
    """What the light of a bench does, in the model of every reading; off unless given."""

    curvature_per_m: Curvatures = Field(
        (0.0, 0.0, 0.0),
        description="of the wavefront, one over its radius: xx, xy, yy along x_w and y_w; "
        "positive where it spreads",
    )
    wavelength_nm: float | None = Field(
        None, gt=0, le=20_000, description="of the light, for diffraction at edges; null for none"
    )
    rolloff_nm: Depths = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        description="depth by which a facet falls off at an edge: of a at ca and ab, of b at ab "
        "and bc, of c at bc and ca",
    )
    rolloff_width_um: float = Field(
        0.0,
        ge=0,
        le=1000,
        description="width of the strip over which a facet falls off, from where a lost strip ends",
    )
    strips_um: Widths = Field(
        (0.0, 0.0, 0.0), description="width of the strips lost along the edges ca, ab, bc"
    )
    tip_um2: float = Field(
        0.0, ge=-1e6, le=1e6, description="area lost at a worn tip, beside what strips take"
    )
    background_uw: Powers = Field(
        (0.0, 0.0, 0.0), description="other light on detectors A, B and C"
    )
    background_mm: Places = Field(
        ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
        description="psi and zeta of its centroid on each detector",
    )
    index: Annotated[tuple[Index, Index], BeforeValidator(as_tuple)] | None = Field(
        None, description="complex refractive index n, k of the coating; null reflects all"
    )
    polarization_deg: float | None = Field(
        None, ge=-360, le=360, description="of the light, from the beam's x axis; null is none"
    )
    delays_us: Delays = Field(
        (0.0, 0.0, 0.0),
        description="by how much detectors A, B and C are read after the stated time",
    )


class CalibrationKeys(Section):
    """The covariance of parameters that were calibrated."""

    file: str | None = Field(None, description="CSV file of the covariance, path from this file")
    sha256: str | None = Field(None, pattern="^[0-9a-f]{64}$", description="of that file")


class SensorKeys(Section):
    """Beam, mirror, detectors and their noise."""

    beam: Beam = Field(Beam(), description="the laser beam")
    mirror: Mirror = Field(Mirror(), description="the three-facet mirror")
    psd: Psds = Field(Psds(), description="the position-sensitive detectors")
    noise: Noise = Field(Noise(), description="noise of the readings, 1 sigma")
    electronics: Electronics = Field(
        Electronics(), description="for `noise.model: electronics`: what the noise comes from"
    )
    apertures: Apertures = Field(Apertures(), description="what cuts the light; off unless given")
    imperfections: Imperfections = Field(
        Imperfections(), description="of the optics, in simulations alone; off unless given"
    )
    light: LightKeys = Field(
        LightKeys(), description="of the bench, known to the model; off unless given"
    )
    calibration: CalibrationKeys = Field(
        CalibrationKeys(), description="how well the parameters are known; from `facets calibrate`"
    )


#: One of the kinds of motions, which has other keys than the others.
MOTION: Any = Annotated[
    Union[tuple(model_of(block_of(kind), kind=kind.kind) for kind in KINDS)],  # noqa: UP007
    Field(discriminator="kind"),
]
MOTIONS: Any = dict[NAME, MOTION]
KEYS: dict[str, Any] = {
    "extends": (
        str | list[str] | None,
        Field(
            None,
            description="shipped name, or path from this file, whose keys this file overrides; of "
            "several, the later override the earlier",
        ),
    ),
    "sensor": (SensorKeys, Field(SensorKeys(), description="the sensor")),
    "motions": (
        Annotated[MOTIONS, BeforeValidator(none_to_block)],
        Field({}, description="name: motion; `facets simulate` runs them one after the other"),
    ),
    **{key.name: (type_of(key), field_of(key)) for key in block_of(Config).keys},
}
#: A whole file.
Document: Any = create_model(
    "Document",
    __base__=StrictModel,
    __doc__="A configuration of the three-facet-mirror 6-DOF sensor.",
    **KEYS,
)
