"""The keys of a layout to be found: what may change, over what volume, and what is asked of it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from .motion_keys import Box
from .section import Section


def _two(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def bounds(low: float, high: float) -> Any:
    """Two numbers, least and most, both within what the key can mean."""
    part = Annotated[float, Field(ge=low, le=high)]
    return Annotated[tuple[part, part], BeforeValidator(_two)] | None


class Variables(Section):
    """What may change, from least to most; what is left out stays as it is."""

    radius_mm: bounds(1, 10_000) = Field(None, description="of all detectors")  # type: ignore[valid-type]
    inclination_deg: bounds(5, 85) = Field(  # type: ignore[valid-type]
        None, description="of all facets; the detectors' heights follow the sub-beams"
    )
    pitch_mrad: bounds(-1000, 1000) = Field(None, description="of all detectors")  # type: ignore[valid-type]
    azimuth_b_deg: bounds(20, 170) = Field(  # type: ignore[valid-type]
        None, description="of facet and detector B; C's mirrors it"
    )
    size_mm: bounds(0.1, 1000) = Field(None, description="of all detectors, square")  # type: ignore[valid-type]
    diameter_mm: bounds(0.01, 100) = Field(None, description="of a round beam, 1/e^2")  # type: ignore[valid-type]
    power_mw: bounds(0.001, 1000) = Field(None, description="of the laser")  # type: ignore[valid-type]


class Finest(Section):
    """Standard uncertainties that count as 1 in the objective, and that are asked for as limits."""

    tx_um: float | None = Field(None, gt=0, le=1e6, description="of tx")
    ty_um: float | None = Field(None, gt=0, le=1e6, description="of ty")
    tz_um: float | None = Field(None, gt=0, le=1e6, description="of tz")
    roll_urad: float | None = Field(None, gt=0, le=1e6, description="of roll")
    pitch_urad: float | None = Field(None, gt=0, le=1e6, description="of pitch")
    yaw_urad: float | None = Field(None, gt=0, le=1e6, description="of yaw")


class Optimize(Section):
    """What `facets optimize` looks for."""

    variables: Variables = Field(Variables(), description="what may change")
    volume: Box = Field(
        Box(tx_mm=0.1, ty_mm=0.1, tz_mm=3, roll_mrad=5, pitch_mrad=5, yaw_mrad=10),
        description="half widths of the poses to be measured; bx_mm, by_mm: of the beam's offset",
    )
    aim: Literal["resolution", "mean-resolution", "range", "size"] = Field(
        "resolution",
        description="finest at worst or on average over the volume; the volume as many times as "
        "large as can be; or the smallest head",
    )
    unit: Finest = Field(
        Finest(tz_um=1, roll_urad=5, pitch_urad=5, yaw_urad=5),
        description="uncertainty of each axis that counts as 1; axes left out do not count",
    )
    limit: Finest = Field(Finest(), description="largest uncertainty of each axis in the volume")
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
