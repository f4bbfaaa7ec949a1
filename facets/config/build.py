"""From checked keys to plain resolved types, and from those to what the code works with."""

from __future__ import annotations

from copy import deepcopy
from math import inf, radians
from pathlib import Path
from typing import Any

from ..core.keys import block_of
from ..core.motions import KINDS, Motion
from ..core.names import DETECTORS
from ..core.sensor import Apertures, Electronics, Imperfections, Noise, Sensor
from . import covariance, geometry


def resolve(document: Any) -> dict[str, Any]:
    """Every key with its value, per detector, as plain types; loads again to the same."""
    plain: dict[str, Any] = document.model_dump(mode="json", by_alias=True, exclude={"extends"})
    plain["sensor"]["mirror"] = _singles(document.sensor.mirror)
    plain["sensor"]["psd"] = _singles(document.sensor.psd)
    return plain


def _singles(common: Any) -> dict[str, Any]:
    """a, b and c in full: their own keys, else the common ones, else the nominal azimuth."""
    shared = common.model_dump(mode="json", exclude=set(DETECTORS))
    return {
        name: _laid(
            {**deepcopy(shared), "azimuth_deg": 120.0 * k},
            getattr(common, name).model_dump(mode="json", exclude_unset=True),
        )
        for k, name in enumerate(DETECTORS)
    }


def _laid(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """`above` over `below`, key by key, block by block."""
    blocks = {
        key: _laid(below[key], value) if isinstance(value, dict) else value
        for key, value in above.items()
    }
    return {**below, **blocks}


def sensor(keys: dict[str, Any]) -> Sensor:
    """A Sensor from the resolved `sensor` block."""
    noise = keys["noise"]
    return Sensor(
        beam=geometry.beam(keys["beam"]),
        facets=geometry.facets(keys["mirror"]),
        psds=geometry.psds(keys["psd"]),
        noise=Noise(
            position=noise["position_um"] / 1000,
            at_power=noise["at_power_mw"],
            power=noise["power_uw"] / 1000,
        ),
        apertures=_apertures(keys["apertures"]),
        electronics=electronics(keys["electronics"]) if noise["model"] == "electronics" else None,
        imperfections=imperfections(keys["imperfections"]),
        light=geometry.light(keys["light"]),
        calibration=None
        if keys["calibration"]["file"] is None
        else covariance.read(Path(keys["calibration"]["file"])),
    )


def imperfections(keys: dict[str, Any]) -> Imperfections:
    turn, radius = keys["polarization_deg"], keys["wavefront_radius_mm"]
    return Imperfections(
        index=None if keys["index"] is None else tuple(keys["index"]),
        polarization=None if turn is None else radians(turn),
        wavefront_radius=inf if radius is None else radius,
        wavelength=1e-6 * (keys["wavelength_nm"] or 0.0),
        sag=tuple(1e-6 * nm for nm in keys["sag_nm"]),
        sag_over=keys["sag_over_mm"],
        **geometry.edge_fields(keys),
    )


def electronics(keys: dict[str, Any]) -> Electronics:
    return Electronics(
        kind=keys["kind"],
        responsivity=keys["responsivity_a_w"],
        dark_current=1e-9 * keys["dark_current_na"],
        resistance=1e3 * keys["resistance_kohm"],
        transimpedance=1e3 * keys["transimpedance_kohm"],
        voltage_noise=1e-9 * keys["voltage_noise_nv_rthz"],
        current_noise=1e-12 * keys["current_noise_pa_rthz"],
        bandwidth=keys["bandwidth_hz"],
        temperature=keys["temperature_k"],
        adc_bits=keys["adc_bits"],
        adc_range=keys["adc_range_v"],
        ambient=1e-3 * keys["ambient_uw"],
        power_noise=1e-6 * keys["power_noise_ppm"],
        pointing=1e-3 * keys["pointing_um"],
    )


def _apertures(keys: dict[str, Any]) -> Apertures:
    return Apertures(
        beam=inf if keys["beam_ratio"] is None else keys["beam_ratio"],
        detectors=keys["detectors"],
        tip=keys["tip_um"] / 1000,
        rim=inf if keys["rim_mm"] is None else keys["rim_mm"],
        gap=keys["gap_um"] / 1000,
    )


#: The classes of motions by the word in a file.
MOTIONS = {kind.kind: block_of(kind) for kind in KINDS}


def motion(keys: dict[str, Any]) -> Motion:
    """A motion from its resolved block."""
    made: Motion = MOTIONS[keys["kind"]].read(keys)
    return made
