"""An interactive page of a sensor: one HTML file that needs no network.

Sliders move the mirror and the beam; readings and rays are computed by the optics' own formulas.
"""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any

from ...config.build import differences
from ...config.checks import resolve
from ...core.errors import InputError
from ...core.names import DETECTORS, STATE, STATE_COLUMNS, STATE_UNITS
from ...core.sensor import Sensor
from ...core.settings import Config
from ...core.units import Floats
from ...core.version import __version__
from ...detectors.correction import is_corrected
from ...files.whole import write_text
from ..stills.range_solid import COLOURS
from .model import model, text_of
from .scripts import RIG

#: The description of each component of a state.
WORDS = {
    "tx": "along x",
    "ty": "along y",
    "tz": "up",
    "roll": "about x",
    "pitch": "about y",
    "yaw": "about z",
    "bx": "beam, x",
    "by": "beam, y",
}
#: The parts of the page within scripts, which must not contain a script's end tag.
SCRIPTS = ("THREE", "PAPA", "MODEL", "DATA", "SCRIPTS")
#: The page's own scripts, in the order in which they need each other.
OWN_SCRIPTS = (
    "digits", "scene", "faces", "parts", "panel", "tables", "hands",
    "geometry", "estimate", "limits",
)  # fmt: skip
#: The blocks of a configuration that the page saves.
SAVED = ("sensor", "range", "solve")
#: Round ends of a slider, times a power of ten.
ROUND = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def rig_page(
    sensor: Sensor, name: str, state: Floats, view: str = "rig", config: Config | None = None
) -> str:
    """Return the page of a sensor, initially at a state (8,) in mm and rad.

    name: of its configuration.  view: the camera's target: "mirror", or a detector: "A"; the whole
    rig for any other word.  config: the configuration, which has the rules of the range, and of
    which the page saves a changed copy.
    """
    if not all(map(_is_finite, state)):
        raise InputError("the state has a number that is not finite")
    settings = {
        "name": name,
        "version": __version__,
        "state": [float(x) for x in state],
        "view": view,
        "components": components(sensor),
        "sentences": sentences(sensor),
        "range": {"colours": COLOURS},
        "keys": None if config is None else stated_keys(config.resolved),
        "omitted": omitted_keys(sensor),
        "estimate": estimate_sentences(sensor),
        "knowledge": {} if config is None else knowledge_of(config),
        "offset": [0.0, 0.0] if config is None else list(config.solve.beam_offset),
    }
    parts = {
        "TITLE": html.escape(f"{name}: a three-facet-mirror sensor"),
        "NAME": html.escape(name),
        "BASE": text_of("base.css"),
        "STYLE": text_of("page.css"),
        "LICENCE": text_of("vendor/three-LICENSE") + text_of("vendor/papaparse-LICENSE"),
        "THREE": text_of("vendor/three.min.js"),
        "PAPA": text_of("vendor/papaparse.min.js"),
        "MODEL": model(sensor, config.range if config else None),
        "DATA": f"{RIG}const PAGE = {data(settings)};",
        "SCRIPTS": "\n".join(text_of(f"{name}.js") for name in OWN_SCRIPTS),
    }
    text = text_of("page.html")
    for mark, part in parts.items():
        before, after = text.split(f"@{mark}@", 1)
        ended = part.replace("</", "<\\/") if mark in SCRIPTS else part
        text = before + ended + after
    return text


def stated_keys(resolved: dict[str, Any]) -> dict[str, Any]:
    """The keys of a configuration's sensor, range and solver that differ from their defaults.

    Data from other files is excluded.
    """
    usual, _ = resolve({})
    stated = {block: differences(usual[block], resolved[block]) for block in SAVED}
    stated["sensor"].pop("calibration", None)
    for letter in DETECTORS:
        correction = stated["sensor"].get("psd", {}).get(letter, {}).get("correction", {})
        for key in ("table", "table_sha256"):
            correction.pop(key, None)
    return stated


def omitted_keys(sensor: Sensor) -> list[str]:
    """State which data a changed copy of the configuration does not contain."""
    texts = []
    if sensor.calibration is not None:
        texts.append("The calibration's covariance is left out: it was that of another sensor.")
    if any(psd.correction.grid is not None for psd in sensor.psds):
        texts.append("The tables of corrections (sensor.psd.a.correction.table) are left out.")
    return texts


def knowledge_of(config: Config) -> dict[str, str]:
    """The words of a configuration's `solve` for beam and power that the page has, too.

    A prior is not among them.
    """
    words = {"beam": config.solve.beam, "power": config.solve.power}
    return {name: value for name, value in words.items() if value in ("free", "known", "unknown")}


def estimate_sentences(sensor: Sensor) -> list[str]:
    """State what the page's noise and uncertainties omit."""
    texts = []
    if sensor.electronics is not None:
        texts.append("The noise is drawn without the steps of the converter.")
    if sensor.calibration is not None:
        texts.append("The stated uncertainties are those by noise, without the calibration's part.")
    return texts


def write_rig_page(
    sensor: Sensor,
    name: str,
    state: Floats,
    path: Path,
    view: str = "rig",
    config: Config | None = None,
) -> None:
    """Write `rig_page` to a file; a failure leaves no partial file."""
    text = rig_page(sensor, name, state, view, config)
    write_text(path, text)


def _is_finite(number: Any) -> bool:
    return bool(abs(number) < float("inf"))


def data(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def components(sensor: Sensor) -> list[dict[str, Any]]:
    """Return each component of the state: its column, unit, words, and the ends of its slider.

    At the ends a spot leaves its detector, or the apex leaves the beam; in that unit.
    """
    psds = sensor.psds
    up = max(psd.size_z for psd in psds) / 2
    lever = min(psd.radius for psd in psds)
    wide = max(sensor.beam.diameter_x, sensor.beam.diameter_y) / 2
    ends = {
        "tz": up, "roll": up / (2 * lever), "pitch": up / (2 * lever),
        "yaw": max(psd.size_y for psd in psds) / 2 / lever,
    }  # fmt: skip
    return [
        {
            "key": column,
            "symbol": name,
            "unit": column.rpartition("_")[2],
            "words": WORDS[name],
            "factor": unit,
            "end": round_up(1.05 * ends.get(name, wide) / unit),
        }
        for name, column, unit in zip(STATE, STATE_COLUMNS, STATE_UNITS, strict=True)
    ]


def round_up(value: float) -> float:
    """Return the next round number, for the end of a slider."""
    power = 10.0 ** int(f"{value:e}".partition("e")[2])
    return next(float(f"{each * power:.2g}") for each in ROUND if each * power >= value)


def sentences(sensor: Sensor) -> list[str]:
    """State the effects that the page's numbers include, and those that they omit."""
    texts = []
    light, openings = sensor.light, sensor.apertures
    if light.on:
        texts.append(
            "The readings include the light of this bench: what sensor.light says of wavefront, "
            "edges, coating and background. The pictures show the light before diffraction."
        )
    if openings.cut:
        texts.append(
            "The readings are those of light that the sensor's apertures cut. A spot near a "
            "detector's edge is drawn whole."
        )
    if any(light.delays):
        texts.append(
            "The detectors are read at different times (light.delays). That concerns a mirror in "
            "motion; here it is at rest."
        )
    if is_corrected(sensor):
        texts.append(
            "The readings are those of the light itself, before what the calibration adds to the "
            "detectors' places and powers."
        )
    texts.append("The readings are without noise.")
    return texts
