"""Beam, facets and detectors: from their keys to what the code works with, and back."""

from __future__ import annotations

from copy import deepcopy
from math import degrees, pi, radians
from pathlib import Path
from typing import Any

from ..core.names import DETECTORS
from ..core.sensor import Beam, BenchLight, Correction, Facet, Psd, Sensor
from . import grid

#: How many of a key's unit make one of the code's.
MM, MW, MRAD, DEG, UM, UW, PERCENT = 1.0, 1.0, 1000.0, 180 / pi, 1000.0, 1000.0, 100.0
Keys = dict[str, tuple[tuple[str, ...], float]]
#: Each key with the fields that it gives, and its unit; keys of two fields are lists.
BEAM: Keys = {
    "power_mw": (("power",), MW),
    "diameter_mm": (("diameter_x", "diameter_y"), MM),
    "rotation_deg": (("rotation",), DEG),
    "tilt_mrad": (("tilt_x", "tilt_y"), MRAD),
}
FACET: Keys = {"inclination_deg": (("inclination",), DEG), "azimuth_deg": (("azimuth",), DEG)}
PSD: Keys = {
    "radius_mm": (("radius",), MM),
    "azimuth_deg": (("azimuth",), DEG),
    "height_mm": (("height",), MM),
    "roll_mrad": (("roll",), MRAD),
    "pitch_mrad": (("pitch",), MRAD),
    "yaw_mrad": (("yaw",), MRAD),
    "size_mm": (("size_y", "size_z"), MM),
}


def beam(keys: dict[str, Any]) -> Beam:
    return Beam(**_fields(keys, BEAM))


def facets(keys: dict[str, Any]) -> tuple[Facet, Facet, Facet]:
    a, b, c = (Facet(**_fields(keys[letter], FACET)) for letter in DETECTORS)
    return a, b, c


def psds(keys: dict[str, Any]) -> tuple[Psd, Psd, Psd]:
    a, b, c = (_psd(keys[letter]) for letter in DETECTORS)
    return a, b, c


def _psd(keys: dict[str, Any]) -> Psd:
    given: Any = _fields(keys, PSD)
    return Psd(**given, correction=_correction(keys["correction"]))


def _correction(keys: dict[str, Any]) -> Correction:
    y, z = (tuple(um / UM for um in keys[key]) for key in ("y_um", "z_um"))
    measured = None if keys["table"] is None else grid.read(Path(keys["table"]))
    return Correction(keys["power_percent"] / PERCENT, keys["dark_uw"] / UW, y, z, measured)


def light(keys: dict[str, Any]) -> BenchLight:
    """The light of the bench from its keys."""
    xx, xy, yy = (value / 1000 for value in keys["curvature_per_m"])
    turn = keys["polarization_deg"]
    return BenchLight(
        curvature_xx=xx,
        curvature_xy=xy,
        curvature_yy=yy,
        wavelength=1e-6 * (keys["wavelength_nm"] or 0.0),
        **edge_fields(keys),
        index=None if keys["index"] is None else tuple(keys["index"]),
        polarization=None if turn is None else radians(turn),
        delays=tuple(1e-6 * delay for delay in keys["delays_us"]),
    )


def edge_fields(keys: dict[str, Any]) -> dict[str, Any]:
    """What the facets' edges, the tip and other light do, from their keys."""
    places = zip(keys["background_uw"], keys["background_mm"], strict=True)
    return {
        "rolloff": tuple(1e-6 * depth for depth in keys["rolloff_nm"]),
        "rolloff_width": keys["rolloff_width_um"] / UM,
        "strips": tuple(width / UM for width in keys["strips_um"]),
        "tip": 1e-6 * keys["tip_um2"],
        "background": tuple((power / UW, *place) for power, place in places),
    }


def light_keys(of: BenchLight) -> dict[str, Any]:
    """The keys of a bench's light, for `light`."""
    return {
        "curvature_per_m": [1000 * v for v in (of.curvature_xx, of.curvature_xy, of.curvature_yy)],
        "wavelength_nm": 1e6 * of.wavelength or None,
        "rolloff_nm": [1e6 * depth for depth in of.rolloff],
        "rolloff_width_um": UM * of.rolloff_width,
        "strips_um": [UM * width for width in of.strips],
        "tip_um2": 1e6 * of.tip,
        "background_uw": [UW * row[0] for row in of.background],
        "background_mm": [list(row[1:]) for row in of.background],
        "index": None if of.index is None else list(of.index),
        "polarization_deg": None if of.polarization is None else degrees(of.polarization),
        "delays_us": [1e6 * delay for delay in of.delays],
    }


def _fields(keys: dict[str, Any], table: Keys) -> dict[str, float]:
    fields: dict[str, float] = {}
    for key, (names, unit) in table.items():
        values = keys[key] if len(names) > 1 else [keys[key]]
        fields |= {name: value / unit for name, value in zip(names, values, strict=True)}
    return fields


def written(keys: dict[str, Any], sensor: Sensor) -> dict[str, Any]:
    """The resolved `sensor` block with the sensor's geometry; what is unchanged stays as written.

    Noise, electronics, apertures and calibration stay those of the block.
    """
    new = deepcopy(keys)
    _write(new["beam"], beam(keys["beam"]), sensor.beam, BEAM)
    for letter, old, now in zip(DETECTORS, facets(keys["mirror"]), sensor.facets, strict=True):
        _write(new["mirror"][letter], old, now, FACET)
    for letter, before, then in zip(DETECTORS, psds(keys["psd"]), sensor.psds, strict=True):
        _write(new["psd"][letter], before, then, PSD)
        if then.correction != before.correction:
            new["psd"][letter]["correction"] |= {
                "power_percent": PERCENT * then.correction.power,
                "dark_uw": UW * then.correction.dark,
                "y_um": [UM * value for value in then.correction.y],
                "z_um": [UM * value for value in then.correction.z],
            }
    if light(keys["light"]) != sensor.light:
        new["light"] = light_keys(sensor.light)
    return new


def _write(keys: dict[str, Any], old: Any, new: Any, table: Keys) -> None:
    for key, (names, unit) in table.items():
        values = [float(getattr(new, name)) * unit for name in names]
        if values != [getattr(old, name) * unit for name in names]:
            keys[key] = values if len(names) > 1 else values[0]
