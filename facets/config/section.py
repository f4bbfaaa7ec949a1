"""What all blocks of keys have in common."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

MAX_LENGTH = 10_000  # mm
HALF_TURN = 3142  # mrad


def as_tuple(value: Any) -> Any:
    """YAML's list."""
    return tuple(value) if isinstance(value, list) else value


def empty_if_none(value: Any) -> Any:
    """A block of names with nothing in it."""
    return {} if value is None else value


class Section(BaseModel):
    """A block of keys. An empty block, all its keys commented out, takes the defaults."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _empty_block(cls, data: Any) -> Any:
        return empty_if_none(data)


class PerAxis(Section):
    """Standard uncertainties by axis of the pose; an axis left out has none given."""

    tx_um: float | None = Field(None, gt=0, le=1e6, description="of tx")
    ty_um: float | None = Field(None, gt=0, le=1e6, description="of ty")
    tz_um: float | None = Field(None, gt=0, le=1e6, description="of tz")
    roll_urad: float | None = Field(None, gt=0, le=1e6, description="of roll")
    pitch_urad: float | None = Field(None, gt=0, le=1e6, description="of pitch")
    yaw_urad: float | None = Field(None, gt=0, le=1e6, description="of yaw")
