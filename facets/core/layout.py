"""The keys of the block `optimize`: variables and requirements of a layout."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from math import inf
from typing import Literal

from .axis_keys import BOX, HALF_TURN_MRAD, MAX_LENGTH_MM, PER_AXIS, State
from .keys import Key, block_of, block_of_keys, drop_null, item_of, key
from .names import DETECTORS
from .rigid_body import MeasuredObject

Bounds = tuple[float, float]


@dataclass(frozen=True)
class PsdPart:
    """A detector in the catalogue of parts."""

    size: float = key("size_mm", MISSING, "side of the detector's sensitive area", gt=0, le=1000)
    position: float | None = key(
        "position_um",
        None,
        "position noise of the detector, as sensor.noise.position_um, which is the default",
        gt=0,
        le=1000,
    )
    price: float | None = key("price", None, "price of one detector, in any currency", ge=0, le=1e9)
    delivery: float | None = key("delivery_weeks", None, "delivery time", ge=0, le=1000)


@dataclass(frozen=True)
class LaserPart:
    """A laser in the catalogue of parts."""

    power: float = key("power_mw", MISSING, "laser power", gt=0, le=1000)
    diameter: float = key(
        "diameter_mm", MISSING, "1/e^2 diameter of the laser's round beam", gt=0, le=1000
    )
    price: float | None = key(
        "price", None, "price of the laser, in the same currency", ge=0, le=1e9
    )
    delivery: float | None = key("delivery_weeks", None, "delivery time", ge=0, le=1000)


@dataclass(frozen=True)
class AmplifierPart:
    """Amplifiers and converters for all three detectors in the catalogue of parts."""

    power: float = key(
        "power_uw",
        MISSING,
        "noise of a power, as sensor.noise.power_uw",
        gt=0,
        le=1e6,
    )
    price: float | None = key("price", None, "price of all, in the same currency", ge=0, le=1e9)
    delivery: float | None = key("delivery_weeks", None, "delivery time", ge=0, le=1000)


def _variable(name: str, meaning: str, low: float, high: float) -> Key:
    return Key(name, None, meaning, hint=Bounds | None, bounds={"ge": low, "le": high})


def _variables_of_one(kind: str, bounds: dict[str, tuple[float, float]]) -> list[Key]:
    return [
        _variable(f"{kind}_{letter}_{name}", f"{kind} {letter} alone", *limits)
        for letter in DETECTORS
        for name, limits in bounds.items()
    ]


VARIABLES = block_of_keys(
    "Variables",
    "Variables of the layout, each with its least and largest value; omitted variables remain "
    "unchanged.",
    [
        _variable("radius_mm", "radius of all detectors", 1, 10_000),
        _variable(
            "inclination_deg",
            "inclination of all facets; the detectors' heights follow the sub-beams",
            5,
            85,
        ),
        *(
            _variable(name, "rotation of all detectors", -1000, 1000)
            for name in ("roll_mrad", "pitch_mrad", "yaw_mrad")
        ),
        _variable(
            "azimuth_b_deg", "azimuth of facet and detector B; that of C mirrors it", 20, 170
        ),
        _variable("size_mm", "side of all detectors, square", 0.1, 1000),
        _variable("diameter_mm", "1/e^2 diameter of a round beam", 0.01, 100),
        _variable("power_mw", "power of the laser", 0.001, 1000),
        _variable(
            "transimpedance_kohm",
            "gain of all amplifiers, for `noise.model: electronics`",
            0.001,
            1e9,
        ),
        *_variables_of_one("facet", {"inclination_deg": (5, 85), "azimuth_deg": (-360, 360)}),
        *_variables_of_one(
            "psd",
            {
                "radius_mm": (1, MAX_LENGTH_MM),
                "azimuth_deg": (-360, 360),
                "height_mm": (-MAX_LENGTH_MM, MAX_LENGTH_MM),
                "roll_mrad": (-HALF_TURN_MRAD, HALF_TURN_MRAD),
                "pitch_mrad": (-HALF_TURN_MRAD, HALF_TURN_MRAD),
                "yaw_mrad": (-HALF_TURN_MRAD, HALF_TURN_MRAD),
            },
        ),
    ],
    drop_null,
)
PARTS = Key(
    "parts",
    {},
    "parts of a catalogue; they replace the variables size_mm and power_mw",
    block=block_of_keys(
        "Parts",
        "Parts that can be bought; from each kind that is listed the search takes the best one.",
        [
            Key(
                "psds",
                {},
                "detectors by name; three of one kind are used",
                named=block_of(PsdPart),
            ),
            Key("lasers", {}, "name: laser", named=block_of(LaserPart)),
            Key("amplifiers", {}, "name: amplifiers", named=block_of(AmplifierPart)),
        ],
        dict,
    ),
)
WEIGHTS = block_of_keys(
    "Weights",
    "Weights of the aims, for `aim: weighted`; omitted aims have the weight 0.",
    [
        Key(name, 0, meaning, hint=float, bounds={"ge": 0, "le": 1e6})
        for name, meaning in {
            "resolution": "weight of the largest uncertainty over its unit",
            "mean_resolution": "weight of the mean uncertainty over its unit",
            "range": "weight of the factor by which the volume is enlarged",
            "size": "weight of the head's diameter in units of 100 mm",
            "condition": "weight of the worst condition number in decades",
            "price": "weight of the price of the parts, in thousands; not counted if a price is "
            "unknown",
        }.items()
    ],
    lambda **values: {name.replace("_", "-"): weight for name, weight in values.items() if weight},
)
PRODUCTION = Key(
    "production",
    {},
    "requirements that heads keep as they are built",
    block=block_of_keys(
        "Production",
        "Requirements on heads as they are built, with the tolerances that `calibrate.before` "
        "states.",
        [
            Key(
                "yield_percent",
                None,
                "percentage of heads that must keep spots, light and limits; null: only the "
                "design must keep them",
                "percent",
                float | None,
                {"gt": 0, "lt": 100},
                null=0.0,
            ),
            Key(
                "calibrated",
                True,
                "whether each head is calibrated, so that `accuracy` holds after the calibration",
                hint=bool,
            ),
            Key(
                "poses",
                60,
                "number of poses of the calibration's motion, with the uncertainties of "
                "`calibrate.reference`",
                hint=int,
                bounds={"ge": 10, "le": 10_000},
            ),
        ],
        dict,
    ),
)


@dataclass(frozen=True)
class Layout:
    """Settings of `facets optimize`.

    variables: least and largest value of each, in the unit of its name.  volume: (8,) half widths
    of the pose and of the beam's offset, mm and rad.  unit, limit, accuracy: (6,) um and urad,
    infinite if not stated.  production: fraction of the heads that must meet all requirements, 0 if
    only the design must.  object: to which volume, unit, limit and accuracy refer; None: the
    mirror's pose.
    """

    variables: dict[str, Bounds] = key("variables", {}, "variables of the search", block=VARIABLES)
    psds: dict[str, PsdPart] = item_of(PARTS, "psds")
    lasers: dict[str, LaserPart] = item_of(PARTS, "lasers")
    amplifiers: dict[str, AmplifierPart] = item_of(PARTS, "amplifiers")
    volume: State = key(
        "volume",
        {"tx_mm": 0.1, "ty_mm": 0.1, "tz_mm": 3, "roll_mrad": 5, "pitch_mrad": 5, "yaw_mrad": 10},
        "half widths of the poses to be measured; bx_mm, by_mm: of the beam's offset",
        block=BOX,
    )
    aim: Literal["resolution", "mean-resolution", "range", "size", "condition", "weighted"] = key(
        "aim",
        "resolution",
        "aim of the search: smallest worst or mean uncertainty in the volume, largest volume, "
        "smallest head, best condition, or a weighted sum by `weights`",
    )
    weights: dict[str, float] = key(
        "weights", {}, "weights of the aims, for `aim: weighted`", block=WEIGHTS
    )
    unit: tuple[float, ...] = key(
        "unit",
        {"tz_um": 1, "roll_urad": 5, "pitch_urad": 5, "yaw_urad": 5},
        "uncertainty of each axis that counts as 1; omitted axes do not count",
        block=PER_AXIS,
    )
    limit: tuple[float, ...] = key(
        "limit", {}, "largest uncertainty of each axis in the volume", block=PER_AXIS
    )
    accuracy: tuple[float, ...] = key(
        "accuracy",
        {},
        "largest error of a head as built in the volume, relative to rest, without noise",
        block=PER_AXIS,
    )
    production: float = item_of(PRODUCTION, "yield_percent")
    calibrated: bool = item_of(PRODUCTION, "calibrated")
    poses: int = item_of(PRODUCTION, "poses")
    head: float = key(
        "head_mm",
        None,
        "largest diameter of the head, over the detectors",
        gt=0,
        le=20_000,
        null=inf,
    )
    least_power: float = key(
        "least_power_uw", 32.4, "least power on a detector in the volume", gt=0, le=1e6
    )
    following: bool = key(
        "beam",
        "free",
        "whether the beam's position at rest is an unknown, or the beam follows the apex",
        words={"free": False, "following": True},
    )
    starts: int = key(
        "starts",
        4,
        "number of starts of the search, the first from the configuration itself",
        ge=1,
        le=1000,
    )
    seed: int = key("seed", 1, "seed of the random numbers of the other starts", ge=0, le=2**32 - 1)
    object: MeasuredObject | None = None

    @property
    def has_parts(self) -> bool:
        """Whether a catalogue of parts is given."""
        return bool(self.psds or self.lasers or self.amplifiers)

    @property
    def aims(self) -> dict[str, float]:
        """The aims and their weights."""
        return self.weights if self.aim == "weighted" else {self.aim: 1.0}
