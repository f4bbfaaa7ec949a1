"""Blocks of keys with one number for each axis of the state."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from .keys import Key, KeyBlock, block_of_keys
from .names import ANGLES, FINE_UNITS, POSE, STATE

MAX_LENGTH_MM = 10_000
HALF_TURN_MRAD = 3142
MAX_UM_OR_URAD = 1e6  # um and urad

State = tuple[float, float, float, float, float, float, float, float]
Pose = tuple[float, float, float, float, float, float]


def _tuple(**values: float) -> tuple[float, ...]:
    return tuple(values.values())


def state_block(
    name: str,
    meaning: str,
    texts: Sequence[str],
    bounds: tuple[dict[str, float], dict[str, float]],
    default: float = 0.0,
    unit: str | None = None,
) -> KeyBlock:
    """A block of keys for the eight components of a state, Eq. (3), read as a tuple.

    texts: meanings of the components.  bounds: of lengths, and of angles.  unit: of all components;
    None: of each component's name.
    """
    keys = []
    for axis, text in zip(STATE, texts, strict=True):
        is_angle = axis in ANGLES
        axis_unit = "mrad" if is_angle else "mm"
        keys.append(
            Key(
                f"{axis}_{axis_unit}",
                default,
                text,
                axis_unit if unit is None else unit,
                float,
                bounds[is_angle],
            )
        )
    return block_of_keys(name, meaning, keys, _tuple)


def pose_block(name: str, meaning: str, length: float | None, angle: float | None) -> KeyBlock:
    """A block of keys for the standard uncertainty of each axis of the pose, read as (6,) um and
    urad, infinite for null.

    length, angle: defaults, um and urad.
    """
    keys = [
        Key(
            f"{axis}_urad" if axis in ANGLES else f"{axis}_um",
            angle if axis in ANGLES else length,
            f"standard uncertainty of {axis}",
            hint=float | None,
            bounds={"gt": 0, "le": MAX_UM_OR_URAD},
            null=inf,
        )
        for axis in POSE
    ]
    return block_of_keys(name, meaning, keys, _tuple)


def convert_fine_units(uncertainties: Sequence[float]) -> tuple[float, ...]:
    """Convert uncertainties (6,) from um and urad to mm and rad."""
    return tuple(value * unit for value, unit in zip(uncertainties, FINE_UNITS, strict=False))


def _symmetric_bounds(largest: float) -> dict[str, float]:
    return {"ge": -largest, "le": largest}


def _positive(largest: float) -> dict[str, float]:
    return {"ge": 0, "le": largest}


PLACE = state_block(
    "Place",
    "A state of the mirror and the beam, or a difference of two.",
    (
        "mirror apex along x_w",
        "mirror apex along y_w",
        "mirror apex along z_w",
        "gamma, about the mirror's x",
        "beta, about y, after roll",
        "alpha, about z, last",
        "beam centre along x_w",
        "beam centre along y_w",
    ),
    (_symmetric_bounds(MAX_LENGTH_MM), _symmetric_bounds(HALF_TURN_MRAD)),
)
BOX = state_block(
    "Box",
    "Half the width of a range on each axis.",
    [f"half-width on {axis}" for axis in STATE],
    (_positive(MAX_LENGTH_MM), _positive(HALF_TURN_MRAD)),
)
CYCLES = state_block(
    "Cycles",
    "Periods on each axis over the whole motion.",
    [f"periods of {axis}" for axis in STATE],
    (_positive(1e6), _positive(1e6)),
    default=1.0,
    unit="",
)
PHASES = state_block(
    "Phases",
    "Phase of each axis at the beginning; 90 makes a cosine.",
    [f"phase of {axis}, degrees" for axis in STATE],
    (_symmetric_bounds(360), _symmetric_bounds(360)),
    unit="deg_of_phase",
)
PER_AXIS = pose_block(
    "PerAxis",
    "Standard uncertainties by axis of the pose; null or omitted: none.",
    None,
    None,
)
COMPLIANCE = block_of_keys(
    "Compliance",
    "Displacement of the mirror by a static force of 1 N.",
    [
        Key(
            f"{axis}_urad" if axis in ANGLES else f"{axis}_um",
            0.0,
            f"displacement on {axis}",
            "urad" if axis in ANGLES else "um",
            float,
            _symmetric_bounds(MAX_UM_OR_URAD),
        )
        for axis in POSE
    ],
    _tuple,
)
