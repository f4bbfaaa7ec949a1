"""The block `sensor` of a configuration: the keys of its parts, and the conversion to and from a
`Sensor`."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from ..core.keys import FieldSource, Key, KeyBlock, Values, block_of, block_of_keys
from ..core.names import DETECTORS
from ..core.sensor import (
    Apertures,
    Beam,
    BenchLight,
    Calibration,
    Correction,
    Drift,
    Electronics,
    Facet,
    Grid,
    Noise,
    Psd,
    Sensor,
    Thermal,
)
from . import covariance, grid

TABLE = Key(
    "table",
    None,
    "CSV file, path from this file: psi_mm, zeta_mm, add_psi_um, add_zeta_um",
    hint=str,
)


def _checksum_key(name: str) -> Key:
    form = {"pattern": "^[0-9a-f]{64}$", "error": "must be 64 digits and letters a to f"}
    return Key(name, None, "SHA-256 checksum of that file", hint=str, bounds=form)


def _read_grid(values: Values) -> Grid | None:
    return None if values["table"] is None else grid.read(Path(values["table"]))


def _three_of(
    name: str, meaning: str, single: KeyBlock, single_meaning: str, what: str
) -> KeyBlock:
    """A block with the blocks a, b and c and their common keys, which exclude the azimuth."""
    sources = {field: source for field, source in single.sources.items() if field != "azimuth"}
    common = replace(single, sources=sources).keys
    part = KeyBlock(
        f"One{single.name}",
        single_meaning,
        {**sources, "azimuth": single.sources["azimuth"]},
        single.make,
        partial=True,
    )
    keys = [Key(letter, {}, f"{what} {letter} alone", block=part) for letter in DETECTORS]
    parts = block_of_keys(name, meaning, keys, lambda a, b, c: (a, b, c))
    return replace(parts, common=tuple(common))


CORRECTION = block_of(Correction)
CORRECTION = replace(
    CORRECTION,
    sources={
        **CORRECTION.sources,
        "grid": FieldSource((TABLE, _checksum_key("table_sha256")), _read_grid),
    },
)
MIRROR = _three_of(
    "Mirror",
    "The three facets, counter-clockwise seen from above; common keys, then single ones.",
    block_of(Facet),
    "One facet; a key left out takes the value common to the three.",
    "facet",
)
PSD = block_of(Psd)
PSD = replace(
    PSD,
    sources={
        **PSD.sources,
        "correction": FieldSource(
            (
                Key(
                    "correction",
                    {},
                    "correction of the detector's readings; `facets calibrate` writes it",
                    block=CORRECTION,
                ),
            )
        ),
    },
)
PSDS = _three_of(
    "Psds",
    "The three position-sensitive detectors; common keys, then single ones.",
    PSD,
    "One detector; a key left out takes the value common to the three.",
    "PSD",
)
NOISE = block_of(Noise)
NOISE_MODEL = Key(
    "model",
    "simple",
    "source of the noise: the numbers of this block, or the block `electronics`",
    hint=Literal["simple", "electronics"],
)
NOISE = KeyBlock(
    "Noise",
    NOISE.meaning,
    {"model": FieldSource((NOISE_MODEL,)), **NOISE.sources},
    lambda model, **numbers: (model, Noise(**numbers)),
)
APERTURES = block_of(Apertures)
APERTURES = replace(
    APERTURES,
    sources={name: APERTURES.sources[name] for name in ("beam", "detectors", "rim", "tip", "gap")},
)


def _read_calibration(
    file: str | None, sha256: str | None, degrees_of_freedom: float | None
) -> Calibration | None:
    del sha256  # The search for the file verifies the checksum.
    return None if file is None else covariance.read(Path(file), degrees_of_freedom)


CALIBRATION = block_of_keys(
    "Calibration",
    "The covariance of parameters that were calibrated.",
    [
        Key("file", None, "CSV file of the covariance, path from this file", hint=str),
        _checksum_key("sha256"),
        Key(
            "degrees_of_freedom",
            None,
            "degrees of freedom of the calibration's residuals, from which coverage factors "
            "follow; null: unknown",
            hint=float,
            bounds={"gt": 0, "le": 1e9},
        ),
    ],
    _read_calibration,
)


def _make_sensor(noise: tuple[str, Noise], electronics: Electronics, **parts: Any) -> Sensor:
    model, numbers = noise
    used = electronics if model == "electronics" else None
    return Sensor(noise=numbers, electronics=used, **parts)


SENSOR = KeyBlock(
    "Sensor",
    "Beam, mirror, detectors and their noise.",
    {
        field: FieldSource((Key(name, {}, meaning, block=block),))
        for field, name, meaning, block in (
            ("beam", "beam", "the laser beam", block_of(Beam)),
            ("facets", "mirror", "the three-facet mirror", MIRROR),
            ("psds", "psd", "the position-sensitive detectors", PSDS),
            ("noise", "noise", "noise of the readings, 1 sigma", NOISE),
            (
                "electronics",
                "electronics",
                "electronics from which the noise follows, for `noise.model: electronics`",
                block_of(Electronics),
            ),
            ("apertures", "apertures", "apertures that cut the light; off unless given", APERTURES),
            (
                "light",
                "light",
                "effects of real light in the model; off unless given",
                block_of(BenchLight),
            ),
            (
                "thermal",
                "temperature",
                "what follows the temperature, written by `facets calibrate`; counts for "
                "readings with temperature_c, a column or a channel",
                block_of(Thermal),
            ),
            (
                "drift",
                "drift",
                "slow noise that `facets simulate` draws and `facets resolution` states; off "
                "unless given",
                block_of(Drift),
            ),
            (
                "calibration",
                "calibration",
                "uncertainty of calibrated parameters; `facets calibrate` writes it",
                CALIBRATION,
            ),
        )
    },
    _make_sensor,
)


def write_sensor(keys: dict[str, Any], sensor: Sensor) -> dict[str, Any]:
    """Return a resolved `sensor` block with the sensor's geometry, light and temperature.

    Values that are equal to the sensor's keep their spelling. Noise, electronics, apertures and
    calibration remain unchanged.
    """
    new = deepcopy(keys)
    new["beam"] = block_of(Beam).write(keys["beam"], sensor.beam)
    new["light"] = block_of(BenchLight).write(keys["light"], sensor.light)
    new["temperature"] = block_of(Thermal).write(keys["temperature"], sensor.thermal)
    for block, key, parts in (
        (block_of(Facet), "mirror", sensor.facets),
        (PSD, "psd", sensor.psds),
    ):
        for letter, part in zip(DETECTORS, parts, strict=True):
            new[key][letter] = block.write(keys[key][letter], part)
    return new
