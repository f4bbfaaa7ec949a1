"""What all blocks of keys have in common."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator

MAX_LENGTH = 10_000  # mm
HALF_TURN = 3142  # mrad


class Section(BaseModel):
    """A block of keys. An empty block, all its keys commented out, takes the defaults."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _empty_block(cls, data: Any) -> Any:
        return {} if data is None else data
