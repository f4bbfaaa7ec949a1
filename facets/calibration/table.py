"""A table of readings beside a reference, for a calibration; and what came of it, in tables."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.names import ANGLES, DETECTORS, POSE, READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from ..core.sensor import MONOMIALS, Sensor
from ..detectors.correction import corrected
from ..estimation.solver import Prior, solve
from ..estimation.table import BEAM_UNCERTAINTIES, require_known_beam
from ..files import tables
from .bundle_adjustment import MOUNTING, Choice, Data, states_of, values_of
from .fit import Fit

if TYPE_CHECKING:
    from ..core.settings import Calibrate

Floats = NDArray[np.float64]

#: What the reference says, one column an axis that it measures.
REFERENCE = tuple(f"ref_{name}" for name in STATE_COLUMNS[:6])
BEAM = STATE_COLUMNS[6:]


def read(path: Path, settings: Calibrate) -> Data:
    """A table with readings and `REFERENCE`, and `bx_mm`, `by_mm` where the beam moves.

    Raises `InputError` where a column is missing for an axis whose uncertainty is given, and where
    the beam's place is an estimate.
    """
    beside = () if settings.beam == "still" else (*BEAM, *BEAM_UNCERTAINTIES)
    measured = [n for n in range(6) if np.isfinite(settings.reference[n])]
    needed = (*READING_COLUMNS, *(REFERENCE[n] for n in measured))
    parts = []
    for chunk in tables.read_chunks(path, needed, beside, tables.CHUNK):
        require_known_beam(path, chunk, "say `calibrate: {beam: still}` if the laser stood still")
        nothing = np.zeros(len(chunk.lines))
        names = (*READING_COLUMNS, *REFERENCE, *BEAM)
        parts.append(np.column_stack([chunk.columns.get(name, nothing) for name in names]))
    rows = np.concatenate(parts) if parts else np.empty((0, 17))
    good = np.isfinite(rows).all(axis=1)
    if good.sum() < 10:
        raise InputError(f"{path}: {int(good.sum())} whole rows; a calibration needs 10 at least")
    rows = rows[good]
    pose = rows[:, 9:15] * STATE_UNITS[:6]
    return Data(rows[:, :9], pose, np.array(settings.reference), rows[:, 15:])


def choice(sensor: Sensor, before: dict[str, float]) -> Choice:
    """What is to be found, by the keys of `calibrate.before`."""
    sigma: dict[str, float] = {}
    diameter = before.get("beam_diameter_percent", 0) / 100
    sigma["beam.diameter_x"] = diameter * sensor.beam.diameter_x
    sigma["beam.diameter_y"] = diameter * sensor.beam.diameter_y
    sigma["beam.power"] = before.get("laser_percent", 0) / 100 * sensor.beam.power
    for name in ("tilt_x", "tilt_y"):
        sigma[f"beam.{name}"] = before.get("beam_tilt_mrad", 0) / 1000
    place, turn = before.get("psd_place_mm", 0), before.get("psd_turn_mrad", 0) / 1000
    scale, bend = before.get("scale_percent", 0) / 100, before.get("bend_um", 0) / 1000
    for letter, psd in zip(DETECTORS, sensor.psds, strict=True):
        for name in ("inclination", "azimuth"):
            sigma[f"facet_{letter}.{name}"] = before.get("facet_mrad", 0) / 1000
        for name in ("radius", "height"):
            sigma[f"psd_{letter}.{name}"] = place
        sigma[f"psd_{letter}.azimuth"] = place / psd.radius
        for name in ("roll", "pitch", "yaw"):
            sigma[f"psd_{letter}.{name}"] = turn
        sigma[f"correction_{letter}.power"] = before.get("power_percent", 0) / 100
        sigma[f"correction_{letter}.dark"] = before.get("dark_uw", 0) / 1000
        sigma[f"correction_{letter}.y10"] = scale * psd.size_y / 2
        sigma[f"correction_{letter}.z01"] = scale * psd.size_z / 2
        for a, b in MONOMIALS[2:]:
            for axis in "yz":
                sigma[f"correction_{letter}.{axis}{a}{b}"] = bend
    for name in MOUNTING:
        sigma[name] = before.get("lever_mm" if name.startswith("lever") else "apex_mm", 0)
    kept = {name: value for name, value in sigma.items() if value > 0}
    if not kept:
        raise InputError("every key of calibrate.before is null: nothing is to be found")
    return Choice(tuple(kept), np.array(list(kept.values())))


def split(data: Data, share: float) -> tuple[Data, Data]:
    """What is fitted, and what is held back: samples evenly in between."""
    number = np.arange(len(data.raw))
    held = np.floor((number + 1) * share) > np.floor(number * share)
    return data.part(~held), data.part(held)


def unit_of(name: str) -> tuple[str, float]:
    """In which a parameter is told."""
    part = name.rpartition(".")[2]
    if name in MOUNTING or part in ("radius", "height", "diameter_x", "diameter_y"):
        return "mm", 1.0
    if part == "power":
        return ("mW", 1.0) if name.startswith("beam") else ("%", 100.0)
    if part == "dark":
        return "uW", 1e3
    return ("um", 1e3) if name.startswith("correction") else ("mrad", 1e3)


def found_table(nominal: Sensor, found: Fit) -> dict[str, NDArray[Any]]:
    """Each parameter: how far from where it was thought to be, and the uncertainties, told."""
    units = [unit_of(name) for name in found.choice.names]
    factors = np.array([factor for _, factor in units])
    change = found.values - values_of(nominal)[found.choice.places]
    return {
        "parameter": np.array(found.choice.names),
        "unit": np.array([unit for unit, _ in units]),
        "known_before": found.choice.sigma * factors,
        "change": change * factors,
        "u": found.uncertainty * factors,
    }


def validation(nominal: Sensor, found: Fit, held: Data) -> dict[str, NDArray[Any]]:
    """Poses solved from held-back readings less the reference's, r.m.s.; um and urad.

    The beam known where it is said to be.  before: by the nominal sensor, its mean error taken off,
    since where the mirror is on the reference is not known then.  after: by the calibrated one.
    stated: what the uncertainties of pose and reference say.
    """
    units = np.array([1e6 if name in ANGLES else 1e3 for name in POSE])
    known = np.isfinite(held.sigma)
    rows = {}
    for name, sensor, mounting in (
        ("before", nominal, np.zeros(len(MOUNTING))),
        ("after", found.sensor, found.mounting),
    ):
        beam = Prior(held.beam, 0.0)
        solution = solve(sensor, corrected(sensor, held.raw), beam=beam, threads=0)
        error = (solution.state - states_of(held, np.zeros_like(held.pose), mounting))[:, :6]
        if name == "before":
            error = error - np.nanmean(error, axis=0)
        rows[name] = np.sqrt(np.nanmean(error**2, axis=0)) * units
        rows["stated"] = np.sqrt(np.nanmean(solution.uncertainty[:, :6] ** 2, axis=0)) * units
    spread = np.hypot(rows["stated"], np.where(known, held.sigma, 0) * units)
    columns: dict[str, NDArray[Any]] = {"axis": np.array(POSE)}
    columns["unit"] = np.array(["urad" if name in ANGLES else "um" for name in POSE])
    return columns | {
        "before": np.where(known, rows["before"], np.nan),
        "after": np.where(known, rows["after"], np.nan),
        "stated": spread,
    }
