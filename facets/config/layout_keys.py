"""The keys of a layout to be found: what may change, over what volume, and what is asked of it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model

from ..core.names import DETECTORS
from .motion_keys import Box, Name
from .section import HALF_TURN, MAX_LENGTH, PerAxis, Section, as_tuple, empty_if_none


def bounds(low: float, high: float) -> Any:
    """Two numbers, least and most, both within what the key can mean."""
    part = Annotated[float, Field(ge=low, le=high)]
    return Annotated[tuple[part, part], BeforeValidator(as_tuple)] | None


class Common(Section):
    """What may change for all facets or detectors alike."""

    radius_mm: bounds(1, 10_000) = Field(None, description="of all detectors")  # type: ignore[valid-type]
    inclination_deg: bounds(5, 85) = Field(  # type: ignore[valid-type]
        None, description="of all facets; the detectors' heights follow the sub-beams"
    )
    roll_mrad: bounds(-1000, 1000) = Field(None, description="of all detectors")  # type: ignore[valid-type]
    pitch_mrad: bounds(-1000, 1000) = Field(None, description="of all detectors")  # type: ignore[valid-type]
    yaw_mrad: bounds(-1000, 1000) = Field(None, description="of all detectors")  # type: ignore[valid-type]
    azimuth_b_deg: bounds(20, 170) = Field(  # type: ignore[valid-type]
        None, description="of facet and detector B; C's mirrors it"
    )
    size_mm: bounds(0.1, 1000) = Field(None, description="of all detectors, square")  # type: ignore[valid-type]
    diameter_mm: bounds(0.01, 100) = Field(None, description="of a round beam, 1/e^2")  # type: ignore[valid-type]
    power_mw: bounds(0.001, 1000) = Field(None, description="of the laser")  # type: ignore[valid-type]
    transimpedance_kohm: bounds(0.001, 1e9) = Field(  # type: ignore[valid-type]
        None, description="gain of all amplifiers, for `noise.model: electronics`"
    )


#: Of one facet, and of one detector.
OF_A_FACET = {"inclination_deg": bounds(5, 85), "azimuth_deg": bounds(-360, 360)}
OF_A_PSD = {
    "radius_mm": bounds(1, MAX_LENGTH),
    "azimuth_deg": bounds(-360, 360),
    "height_mm": bounds(-MAX_LENGTH, MAX_LENGTH),
    **{name: bounds(-HALF_TURN, HALF_TURN) for name in ("roll_mrad", "pitch_mrad", "yaw_mrad")},
}


def _of_one(kind: str, keys: dict[str, Any]) -> dict[str, Any]:
    return {
        f"{kind}_{letter}_{key}": (bound, Field(None, description=f"of {kind} {letter} alone"))
        for letter in DETECTORS
        for key, bound in keys.items()
    }


Variables = create_model(
    "Variables",
    __base__=Common,
    __doc__="What may change, from least to most; what is left out stays as it is.",
    **_of_one("facet", OF_A_FACET),
    **_of_one("psd", OF_A_PSD),
)


class PsdPart(Section):
    """A detector that can be had."""

    size_mm: float = Field(gt=0, le=1000, description="side of its sensitive area")
    position_um: float | None = Field(
        None, gt=0, le=1000, description="its noise, as sensor.noise.position_um; if left out that"
    )
    price: float | None = Field(None, ge=0, le=1e9, description="of one, in any money")
    delivery_weeks: float | None = Field(None, ge=0, le=1000, description="until it is there")


class LaserPart(Section):
    """A laser that can be had."""

    power_mw: float = Field(gt=0, le=1000, description="laser power")
    diameter_mm: float = Field(gt=0, le=1000, description="1/e^2 diameter of its round beam")
    price: float | None = Field(None, ge=0, le=1e9, description="in the same money")
    delivery_weeks: float | None = Field(None, ge=0, le=1000, description="until it is there")


class AmplifierPart(Section):
    """Amplifiers and converter that can be had, for all three detectors."""

    power_uw: float = Field(gt=0, le=1e6, description="noise of a power, as sensor.noise.power_uw")
    price: float | None = Field(None, ge=0, le=1e9, description="of all, in the same money")
    delivery_weeks: float | None = Field(None, ge=0, le=1000, description="until they are there")


class Parts(Section):
    """A catalogue: of each kind that is listed, the best is taken."""

    psds: Annotated[dict[Name, PsdPart], BeforeValidator(empty_if_none)] = Field(
        {}, description="name: detector; three of the same"
    )
    lasers: Annotated[dict[Name, LaserPart], BeforeValidator(empty_if_none)] = Field(
        {}, description="name: laser"
    )
    amplifiers: Annotated[dict[Name, AmplifierPart], BeforeValidator(empty_if_none)] = Field(
        {}, description="name: amplifiers"
    )


class Weights(Section):
    """How much each aim counts in `aim: weighted`; those left out do not."""

    resolution: float = Field(0, ge=0, le=1e6, description="worst uncertainty over its unit")
    mean_resolution: float = Field(0, ge=0, le=1e6, description="mean uncertainty over its unit")
    range: float = Field(0, ge=0, le=1e6, description="how many times as large the volume is")
    size: float = Field(0, ge=0, le=1e6, description="diameter of the head, 100 mm")
    condition: float = Field(0, ge=0, le=1e6, description="worst condition number, decades")
    price: float = Field(0, ge=0, le=1e6, description="of the parts, thousands; none for unknown")


class Production(Section):
    """Heads as they are built, with the tolerances that `calibrate.before` states."""

    yield_percent: float | None = Field(
        None,
        gt=0,
        lt=100,
        description="share of the heads that must keep spots, light and limits; null: the design",
    )
    calibrated: bool = Field(
        True, description="whether each head is calibrated, so that `accuracy` holds after that"
    )
    poses: int = Field(
        60, ge=10, le=10_000, description="of a calibration's motion, beside `calibrate.reference`"
    )


class Optimize(Section):
    """What `facets optimize` looks for."""

    variables: Variables = Field(Variables(), description="what may change")
    parts: Parts = Field(Parts(), description="what can be had; size_mm and power_mw come from it")
    volume: Box = Field(
        Box(tx_mm=0.1, ty_mm=0.1, tz_mm=3, roll_mrad=5, pitch_mrad=5, yaw_mrad=10),
        description="half widths of the poses to be measured; bx_mm, by_mm: of the beam's offset",
    )
    aim: Literal["resolution", "mean-resolution", "range", "size", "condition", "weighted"] = Field(
        "resolution",
        description="finest at worst or on average over the volume; the volume as many times as "
        "large as can be; the smallest head; the best conditioned; or a sum by `weights`",
    )
    weights: Weights = Field(Weights(), description="of the aims, for `aim: weighted`")
    unit: PerAxis = Field(
        PerAxis(tz_um=1, roll_urad=5, pitch_urad=5, yaw_urad=5),
        description="uncertainty of each axis that counts as 1; axes left out do not count",
    )
    limit: PerAxis = Field(PerAxis(), description="largest uncertainty of each axis in the volume")
    accuracy: PerAxis = Field(
        PerAxis(),
        description="largest error of a head as built in the volume, from rest, without noise",
    )
    production: Production = Field(Production(), description="of heads that are not perfect")
    head_mm: float | None = Field(
        None, gt=0, le=20_000, description="largest diameter of the head, over the detectors"
    )
    least_power_uw: float = Field(
        32.4, gt=0, le=1e6, description="least power on a detector in the volume"
    )
    beam: Literal["free", "following"] = Field(
        "free", description="whether the beam's place is an unknown at rest, or follows the apex"
    )
    starts: int = Field(4, ge=1, le=1000, description="from which it begins, the first as it is")
    seed: int = Field(1, ge=0, le=2**32 - 1, description="of the other starts")
