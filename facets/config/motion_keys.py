"""The keys of the motions. Axes that a motion does not name stay at zero."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from .section import HALF_TURN, MAX_LENGTH, Section, empty_if_none

SAMPLES = Field(ge=1, le=1_000_000_000, description="number of readings")
RATE = Field(gt=0, le=1e9, description="readings per second")

Length = Annotated[float, Field(ge=-MAX_LENGTH, le=MAX_LENGTH)]
Angle = Annotated[float, Field(ge=-HALF_TURN, le=HALF_TURN)]
Width = Annotated[float, Field(ge=0, le=MAX_LENGTH)]
Turn = Annotated[float, Field(ge=0, le=HALF_TURN)]


class Place(Section):
    """A state of the mirror and the beam, or a difference of two."""

    tx_mm: Length = Field(0.0, description="mirror apex along x_w")
    ty_mm: Length = Field(0.0, description="mirror apex along y_w")
    tz_mm: Length = Field(0.0, description="mirror apex along z_w")
    roll_mrad: Angle = Field(0.0, description="gamma, about the mirror's x")
    pitch_mrad: Angle = Field(0.0, description="beta, about y, after roll")
    yaw_mrad: Angle = Field(0.0, description="alpha, about z, last")
    bx_mm: Length = Field(0.0, description="beam centre along x_w")
    by_mm: Length = Field(0.0, description="beam centre along y_w")


class Box(Section):
    """Half the width of a range on each axis."""

    tx_mm: Width = Field(0.0, description="half-width on tx")
    ty_mm: Width = Field(0.0, description="half-width on ty")
    tz_mm: Width = Field(0.0, description="half-width on tz")
    roll_mrad: Turn = Field(0.0, description="half-width on roll")
    pitch_mrad: Turn = Field(0.0, description="half-width on pitch")
    yaw_mrad: Turn = Field(0.0, description="half-width on yaw")
    bx_mm: Width = Field(0.0, description="half-width on bx")
    by_mm: Width = Field(0.0, description="half-width on by")


Count = Annotated[float, Field(ge=0, le=1e6)]


class Cycles(Section):
    """Periods on each axis over the whole motion."""

    tx_mm: Count = Field(1.0, description="periods of tx")
    ty_mm: Count = Field(1.0, description="periods of ty")
    tz_mm: Count = Field(1.0, description="periods of tz")
    roll_mrad: Count = Field(1.0, description="periods of roll")
    pitch_mrad: Count = Field(1.0, description="periods of pitch")
    yaw_mrad: Count = Field(1.0, description="periods of yaw")
    bx_mm: Count = Field(1.0, description="periods of bx")
    by_mm: Count = Field(1.0, description="periods of by")


Phase = Annotated[float, Field(ge=-360, le=360)]


class Phases(Section):
    """Where in its period each axis begins; 90 makes a cosine."""

    tx_mm: Phase = Field(0.0, description="phase of tx, degrees")
    ty_mm: Phase = Field(0.0, description="phase of ty, degrees")
    tz_mm: Phase = Field(0.0, description="phase of tz, degrees")
    roll_mrad: Phase = Field(0.0, description="phase of roll, degrees")
    pitch_mrad: Phase = Field(0.0, description="phase of pitch, degrees")
    yaw_mrad: Phase = Field(0.0, description="phase of yaw, degrees")
    bx_mm: Phase = Field(0.0, description="phase of bx, degrees")
    by_mm: Phase = Field(0.0, description="phase of by, degrees")


class StepsKeys(Section):
    """Stands still at equally spaced places between two, both included."""

    kind: Literal["steps"]
    start: Place = Field(Place(), alias="from", description="first place")
    stop: Place = Field(Place(), alias="to", description="last place")
    steps: int = Field(21, ge=1, le=1_000_000, description="number of places")
    samples_per_step: int = Field(1, ge=1, le=1_000_000, description="readings at each place")
    rate_hz: float = Field(1000.0, gt=0, le=1e9, description="readings per second")


class SweepKeys(Section):
    """Moves evenly from one place to another, both included, all axes at once."""

    kind: Literal["sweep"]
    start: Place = Field(Place(), alias="from", description="first place")
    stop: Place = Field(Place(), alias="to", description="last place")
    samples: Annotated[int, SAMPLES] = 401
    rate_hz: Annotated[float, RATE] = 1000.0


class SineKeys(Section):
    """Each axis swings on its own: centre + amplitude sin(2 pi cycles s + phase), s from 0 to 1."""

    kind: Literal["sine"]
    centre: Place = Field(Place(), description="middle of the swing")
    amplitude: Place = Field(Place(), description="half the swing")
    cycles: Cycles = Field(Cycles(), description="periods over the whole motion")
    phase_deg: Phases = Field(Phases(), description="at the beginning")
    samples: Annotated[int, SAMPLES] = 1000
    rate_hz: Annotated[float, RATE] = 1000.0


class RandomKeys(Section):
    """Independent states, uniform in a box."""

    kind: Literal["random"]
    centre: Place = Field(Place(), description="middle of the box")
    box: Box = Field(Box(), description="half-width of the box on each axis")
    samples: Annotated[int, SAMPLES] = 1000
    rate_hz: Annotated[float, RATE] = 1000.0


class TableKeys(Section):
    """States from a CSV file: columns tx_mm ... yaw_mrad, and if wanted bx_mm, by_mm, time_s."""

    kind: Literal["table"]
    file: str = Field(min_length=1, description="CSV file, path from this file")
    samples_per_step: int = Field(
        1, ge=1, le=1_000_000, description="readings at each row; 1 where the file has time_s"
    )
    rate_hz: float = Field(
        1000.0, gt=0, le=1e9, description="readings per second where the file has no time_s"
    )


MotionKeys = Annotated[
    StepsKeys | SweepKeys | SineKeys | RandomKeys | TableKeys, Field(discriminator="kind")
]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
Motions = Annotated[dict[Name, MotionKeys], BeforeValidator(empty_if_none)]
