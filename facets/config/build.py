"""From checked keys to plain resolved types, and from those to what the code works with."""

from __future__ import annotations

from copy import deepcopy
from math import inf, radians
from pathlib import Path
from typing import Any

from ..core.names import DETECTORS, FINE_UNITS
from ..core.rules import Rules
from ..core.sensor import Apertures, Electronics, Imperfections, Noise, Sensor
from ..core.settings import (
    Acquire,
    AmplifierPart,
    Calibrate,
    LaserPart,
    Layout,
    Motion,
    PsdPart,
    Random,
    Sine,
    Solve,
    Stage,
    State,
    Steps,
    Sweep,
    Table,
)
from . import covariance, geometry
from .keys import Document, Mirror, Psds


def resolve(document: Document) -> dict[str, Any]:
    """Every key with its value, per detector, as plain types; loads again to the same."""
    plain = document.model_dump(mode="json", by_alias=True, exclude={"extends"})
    plain["sensor"]["mirror"] = _singles(document.sensor.mirror)
    plain["sensor"]["psd"] = _singles(document.sensor.psd)
    return plain


def _singles(common: Mirror | Psds) -> dict[str, Any]:
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


def solve(keys: dict[str, Any], detectors: int) -> Solve:
    """detectors: the fewest that a pose is made from, as older files say it."""
    return Solve(
        beam=keys["beam"],
        beam_sigma=keys["beam_sigma_um"] / 1000,
        power=keys["power"],
        power_sigma=keys["power_sigma_percent"] / 100,
        method=keys["method"],
        start=keys["start"],
        max_steps=keys["max_steps"],
        accept_unchecked=keys["accept_unchecked"] or detectors == 2,
    )


def acquire(keys: dict[str, Any]) -> Acquire:
    return Acquire(
        port=keys["port"],
        baud=keys["baud"],
        format=keys["format"],
        content=keys["content"],
        dark=keys["dark_counts"],
        timing=keys["timing"],
        mark=keys["mark"],
        least_delay=keys["least_delay_ms"] / 1000,
        delay=keys["delay_ms"] / 1000,
        wait=keys["wait_seconds"],
        sync=keys["sync_seconds"],
    )


def stage(keys: dict[str, Any]) -> Stage:
    return Stage(
        driver=keys["driver"],
        port=keys["port"],
        baud=keys["baud"],
        step=keys["step_um"] / 1000,
        zero=tuple(keys["zero_mm"]),
        low=tuple(keys["low_mm"]),
        high=tuple(keys["high_mm"]),
        max_speed=keys["max_speed_mm_s"],
        max_step=keys["max_step_mm"],
        rate=keys["rate_hz"],
        accuracy=keys["accuracy_um"] / 1000,
        law=keys["law"],
        gain=keys["gain"],
        integral=keys["integral"],
        stale=keys["stale_ms"] / 1000,
        bridge=keys["bridge_ms"] / 1000,
        bridge_distance=keys["bridge_mm"],
        lag=keys["lag_ms"] / 1000,
        latency=keys["latency_ms"] / 1000,
        acceleration=keys["acceleration_mm_s2"],
        resume=keys["resume"],
        resumes_per_hour=keys["resumes_per_hour"],
        permit=keys["permit"],
        heartbeat=keys["heartbeat"],
        checked=keys["checked"],
    )


def layout(keys: dict[str, Any]) -> Layout:
    return Layout(
        variables={k: tuple(v) for k, v in keys["variables"].items() if v is not None},
        volume=state(keys["volume"]),
        psds={
            name: PsdPart(
                part["size_mm"],
                None if part["position_um"] is None else part["position_um"] / 1000,
                part["price"],
                part["delivery_weeks"],
            )
            for name, part in keys["parts"]["psds"].items()
        },
        lasers={
            name: LaserPart(
                part["power_mw"], part["diameter_mm"], part["price"], part["delivery_weeks"]
            )
            for name, part in keys["parts"]["lasers"].items()
        },
        amplifiers={
            name: AmplifierPart(part["power_uw"] / 1000, part["price"], part["delivery_weeks"])
            for name, part in keys["parts"]["amplifiers"].items()
        },
        aim=keys["aim"],
        weights={name.replace("_", "-"): w for name, w in keys["weights"].items() if w},
        unit=per_axis(keys["unit"]),
        limit=per_axis(keys["limit"]),
        head=inf if keys["head_mm"] is None else keys["head_mm"],
        least_power=keys["least_power_uw"] / 1000,
        following=keys["beam"] == "following",
        starts=keys["starts"],
        seed=keys["seed"],
        accuracy=per_axis(keys["accuracy"]),
        production=(keys["production"]["yield_percent"] or 0.0) / 100,
        calibrated=keys["production"]["calibrated"],
        poses=keys["production"]["poses"],
    )


def per_axis(keys: dict[str, float | None]) -> tuple[float, ...]:
    """(6,) um and urad, infinite where not given."""
    return tuple(inf if value is None else value for value in keys.values())


def calibrate(keys: dict[str, Any]) -> Calibrate:
    sigmas = zip(per_axis(keys["reference"]), FINE_UNITS, strict=False)
    return Calibrate(
        reference=tuple(value * unit for value, unit in sigmas),
        before={name: value for name, value in keys["before"].items() if value is not None},
        power_per_sample=keys["laser"] == "drifts",
        effects=dict(keys["effects"]),
        beam=keys["beam"],
        held_back=keys["held_back_percent"] / 100,
        outliers=keys["outliers"],
    )


def range_(keys: dict[str, Any]) -> Rules:
    """The rules of the measurement range."""
    limits = per_axis(keys["coarsest"])
    return Rules(
        whole_spot=keys["spot"] == "whole",
        snr=keys["snr"],
        condition=keys["condition"],
        coarsest=tuple(value * unit for value, unit in zip(limits, FINE_UNITS, strict=False)),
    )


def state(keys: dict[str, float]) -> State:
    """A place: mm as they are, mrad in rad."""
    tx, ty, tz, roll, pitch, yaw, bx, by = (
        value / 1000 if key.endswith("_mrad") else value for key, value in keys.items()
    )
    return tx, ty, tz, roll, pitch, yaw, bx, by


def motion(keys: dict[str, Any]) -> Motion:
    """A motion from its resolved block."""
    kind, rate = keys["kind"], keys["rate_hz"]
    if kind == "table":
        return Table(Path(keys["file"]), keys["samples_per_step"], rate)
    if kind == "steps":
        ends = state(keys["from"]), state(keys["to"])
        return Steps(*ends, keys["steps"], keys["samples_per_step"], rate)
    samples = keys["samples"]
    if kind == "sweep":
        return Sweep(state(keys["from"]), state(keys["to"]), samples, rate)
    centre = state(keys["centre"])
    if kind == "random":
        return Random(centre, state(keys["box"]), samples, rate)
    cycles = tuple(keys["cycles"].values())
    phase = tuple(radians(value) for value in keys["phase_deg"].values())
    return Sine(centre, state(keys["amplitude"]), cycles, phase, samples, rate)  # type: ignore[arg-type]
