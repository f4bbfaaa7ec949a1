"""Settings of a calibration: prior uncertainties of the reference and the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from .axis_keys import MAX_LENGTH_MM, convert_fine_units, pose_block
from .keys import FieldSource, Key, block_of, block_of_keys, declare, drop_null, key
from .names import TEMPERATURE_COLUMN
from .sensor import LIGHT_CANDIDATES
from .units import bounds_of

REFERENCE = pose_block(
    "Reference",
    "Standard uncertainty of the reference's pose; null for an axis that it does not measure.",
    0.1,
    0.5,
)


def _prior_sigma(name: str, default: float | None, most: float, meaning: str) -> Key:
    return Key(name, default, meaning, hint=float | None, bounds={"gt": 0, "le": most})


BEFORE = block_of_keys(
    "Before",
    "Standard uncertainties before the calibration, from tolerances; null: the value is not "
    "fitted.",
    [
        _prior_sigma(
            "psd_place_mm",
            0.2,
            MAX_LENGTH_MM,
            "position of each PSD's centre, along each direction",
        ),
        _prior_sigma("psd_turn_mrad", 3.0, 1000, "each of a PSD's three rotations"),
        _prior_sigma("facet_mrad", 1.5, 1000, "each facet's inclination and azimuth"),
        _prior_sigma("beam_tilt_mrad", 1.5, 1000, "each of the beam's two tilts"),
        _prior_sigma(
            "beam_diameter_percent", 5.0, 100, "the beam's two diameters, and its roundness"
        ),
        _prior_sigma(
            "beam_profile_percent",
            0.1,
            100,
            "fraction of the laser's power outside the model's cross-section, Gaussian or with "
            "the fitted profile (a ghost, light lost at a chipped tip), if the fit has an effect "
            "of light",
        ),
        _prior_sigma("power_percent", 2.0, 100, "each PSD's gain (not the laser's power)"),
        _prior_sigma("dark_uw", None, 1e6, "power that each PSD reads without light"),
        _prior_sigma(
            "laser_percent",
            None,
            100,
            "the laser's power, where it is constant, or from head to head in `facets tolerances`",
        ),
        _prior_sigma("scale_percent", 2.0, 100, "each PSD's scales along y and z"),
        _prior_sigma(
            "bend_um", None, 10_000, "each PSD's terms of second and third order, at its edge"
        ),
        _prior_sigma(
            "lever_mm", 50.0, MAX_LENGTH_MM, "position of the apex from the reference's pivot"
        ),
        _prior_sigma(
            "apex_mm",
            0.1,
            MAX_LENGTH_MM,
            "position of the apex from the beam, with the reference at zero",
        ),
        _prior_sigma("mount_deg", 3.0, 30, "each rotation of the mirror on the reference"),
    ],
    drop_null,
)
EFFECTS = block_of_keys(
    "Effects",
    "Effects that the fit may include: `auto`, if the data support it; `on`, always.",
    [
        Key(name, "auto", meaning, hint=Literal["auto", "on", "off"])
        for name, meaning in {
            **{name: meaning for name, (meaning, _) in LIGHT_CANDIDATES.items()},
            "bend": "non-linearity of the detectors, of second and third order",
            "spline": "remaining non-linearity of the detectors, as a smooth spline",
            "beam_moves": "position of the beam in each sample",
            "delay": "delay of the reference's clock",
            "backlash": "backlash of the reference's axes",
            "lag": "lag of the mirror by a fraction of each axis's last step",
            "channel_skew": "delay between the detectors, which are read one after the other",
            "time_drift": "drift of the beam and the detectors with time",
            "temperature_drift": "drift of the beam and the detectors with temperature_c",
            "temperature_lag": "drift of the beam and the detectors with the past of temperature_c",
        }.items()
    ],
    dict,
)

#: Allowed form of a certificate's number, which is printed at the foot of each sheet.
NUMBER = {
    "pattern": r"^[\w .,/-]*$",
    "error": "must be letters, digits, spaces and . , / - _",
}


def _entry(name: str, meaning: str, **bounds: Any) -> Any:
    """A key for a text that the user may omit."""
    bounds = {"min_length": 1, "max_length": 400} | bounds
    return declare(FieldSource((Key(name, None, meaning, hint=str | None, bounds=bounds),)))


def _condition(name: str, meaning: str, low: float, high: float) -> Any:
    """A key for the lowest and the highest value of an ambient condition, in its own unit."""
    hint = tuple[float, float] | None
    return declare(
        FieldSource((Key(name, None, meaning, hint=hint, bounds={"ge": low, "le": high}),))
    )


TEMPERATURES = bounds_of(TEMPERATURE_COLUMN).values()


@dataclass(frozen=True)
class Statement:
    """Entries of the calibration certificate (`facets calibrate --report`), which are copied
    unchecked; a missing one is printed as "not stated"."""

    number: str | None = _entry("number", "number of the certificate", **NUMBER)
    sensor: str | None = _entry("sensor", "maker and type of the calibrated sensor")
    serial: str | None = _entry("serial_number", "serial number of the calibrated sensor")
    customer: str | None = _entry("customer", "name and address of the customer")
    laboratory: str | None = _entry("laboratory", "name and address of who calibrated")
    operator: str | None = _entry("operator", "person responsible for the calibration")
    date: str | None = _entry("date", "date of the measurement")
    place: str | None = _entry("place", "place of the measurement")
    reference: str | None = _entry(
        "reference", "maker, type and serial number of the reference instrument"
    )
    traceability: str | None = _entry(
        "traceability",
        "calibration certificates of the reference and the national standards behind them",
    )
    temperature: tuple[float, float] | None = _condition(
        "temperature_c", "lowest and highest temperature during the measurement", *TEMPERATURES
    )
    humidity: tuple[float, float] | None = _condition(
        "humidity_percent", "lowest and highest relative humidity during the measurement", 0, 100
    )
    pressure: tuple[float, float] | None = _condition(
        "pressure_hpa", "lowest and highest air pressure during the measurement", 0, 2000
    )
    remarks: str | None = _entry("remarks", "further conditions, such as the light or the mounting")


@dataclass(frozen=True)
class Calibrate:
    """Settings of `facets calibrate`.

    reference: (6,) standard uncertainties of the reference's pose, mm and rad, infinite for an axis
    that it does not measure.  before: standard uncertainties by key, in the key's unit, without
    keys that are null.  power_per_sample: whether the laser's power is an unknown of each sample.
    effects: "auto", "on" or "off" by effect.  held_back: percentage of samples for the test.
    dwells: whether the rows of each dwell of the reference are averaged.
    """

    reference: tuple[float, ...] = key(
        "reference",
        {},
        "standard uncertainty of the reference's poses",
        block=REFERENCE,
        convert=convert_fine_units,
    )
    before: dict[str, float] = key(
        "before", {}, "standard uncertainty of the sensor before the calibration", block=BEFORE
    )
    power_per_sample: bool = key(
        "laser",
        "drifts",
        "whether the laser's power is an unknown of each sample, or the same in all",
        words={"drifts": True, "constant": False},
    )
    effects: dict[str, str] = key(
        "effects", {}, "effects of real light, detectors and drift to be fitted", block=EFFECTS
    )
    beam: Literal["given", "still"] = key(
        "beam",
        "given",
        "position of the beam: bx_mm, by_mm of the table if it has them; still: the origin",
    )
    held_back: float = key(
        "held_back_percent", 20.0, "part of the samples on which the result is tested", ge=0, le=90
    )
    outliers: float | None = key(
        "outliers", 3.0, "standard deviations beyond which a reading weighs less", gt=0, le=100
    )
    statement: Statement = key(
        "statement",
        {},
        "entries of the calibration certificate on sensor, reference and conditions",
        block=block_of(Statement),
    )
    dwells: bool = False
