"""The keys of a calibration: how well its reference and the sensor are known before."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from .section import MAX_LENGTH, Section


class Reference(Section):
    """Standard uncertainty of what the reference says; an axis that it does not measure is null."""

    tx_um: float | None = Field(0.1, gt=0, le=1e6, description="of tx")
    ty_um: float | None = Field(0.1, gt=0, le=1e6, description="of ty")
    tz_um: float | None = Field(0.1, gt=0, le=1e6, description="of tz")
    roll_urad: float | None = Field(0.5, gt=0, le=1e6, description="of roll")
    pitch_urad: float | None = Field(0.5, gt=0, le=1e6, description="of pitch")
    yaw_urad: float | None = Field(0.5, gt=0, le=1e6, description="of yaw")


class Before(Section):
    """Standard uncertainties before, from tolerances; what is null stays as it is."""

    psd_place_mm: float | None = Field(
        0.2, gt=0, le=MAX_LENGTH, description="of each PSD's centre, along each direction"
    )
    psd_turn_mrad: float | None = Field(3.0, gt=0, le=1000, description="of each PSD's three turns")
    facet_mrad: float | None = Field(
        1.5, gt=0, le=1000, description="of each facet's inclination and azimuth"
    )
    beam_tilt_mrad: float | None = Field(1.5, gt=0, le=1000, description="of the beam's two tilts")
    beam_diameter_percent: float | None = Field(
        5.0, gt=0, le=100, description="of the beam's two diameters, and of its roundness"
    )
    power_percent: float | None = Field(2.0, gt=0, le=100, description="of each PSD's gain")
    dark_uw: float | None = Field(
        None, gt=0, le=1e6, description="of what each PSD reads without light"
    )
    laser_percent: float | None = Field(
        None,
        gt=0,
        le=100,
        description="of the laser's power, where it is constant; or give power_percent",
    )
    scale_percent: float | None = Field(
        2.0, gt=0, le=100, description="of each PSD's scales along y and z"
    )
    bend_um: float | None = Field(
        None, gt=0, le=10_000, description="of each PSD's second and third order, at its edge"
    )
    lever_mm: float | None = Field(
        50.0, gt=0, le=MAX_LENGTH, description="of the apex from the reference's pivot"
    )
    apex_mm: float | None = Field(
        0.1, gt=0, le=MAX_LENGTH, description="of the apex from the beam, the reference at zero"
    )
    mount_deg: float | None = Field(
        3.0, gt=0, le=30, description="of each turn of the mirror on the reference"
    )


Decision = Literal["auto", "on", "off"]


class Effects(Section):
    """Which effects the fit holds: `auto` takes those that the data call for, `on` always."""

    curvature: Decision = Field("auto", description="the wavefront's radius, in two axes")
    diffraction: Decision = Field("auto", description="at the facets' edges")
    rolloff: Decision = Field("auto", description="edges of the facets that are rolled off")
    strips: Decision = Field("auto", description="strips along the edges that reflect nothing")
    tip: Decision = Field("auto", description="a mirror's point that is worn flat")
    background: Decision = Field("auto", description="light that reaches a detector otherwise")
    coating: Decision = Field("auto", description="reflectance by incidence and polarisation")
    bend: Decision = Field("auto", description="detectors that are not linear: 2nd and 3rd order")
    spline: Decision = Field("auto", description="the same beyond, as a smooth spline")
    beam_moves: Decision = Field("auto", description="the beam's place, sample by sample")
    delay: Decision = Field("auto", description="a reference that is late, or early")
    backlash: Decision = Field(
        "auto",
        description="a mirror that lags behind, by the direction of each last step",
    )
    channel_skew: Decision = Field("auto", description="detectors read one after the other")
    time_drift: Decision = Field("auto", description="beam and detectors that drift with time")
    temperature_drift: Decision = Field("auto", description="the same by temperature_c")


class Calibrate(Section):
    """What `facets calibrate` takes and finds."""

    reference: Reference = Field(Reference(), description="how well it knows the motion")
    before: Before = Field(Before(), description="how well the sensor is known")
    laser: Literal["drifts", "constant"] = Field(
        "drifts", description="its power is an unknown of each sample, or the same in all"
    )
    effects: Effects = Field(Effects(), description="of real light, detectors and drift")
    beam: Literal["given", "still"] = Field(
        "given",
        description="its place: bx_mm, by_mm of the table where it has them; still: the origin",
    )
    held_back_percent: float = Field(
        20.0, ge=0, le=90, description="of the samples, on which the result is tried"
    )
    outliers: float | None = Field(
        3.0, gt=0, le=100, description="standard deviations beyond which a reading weighs less"
    )
