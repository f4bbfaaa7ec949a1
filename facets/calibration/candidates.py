"""The effects that a calibration may add to the plain fit, each declared in one place.

Effects of the light are declared on the fields of `core.sensor.BenchLight`; a new effect of the
detectors or of the run needs one entry in `EVERY_EFFECT`. `search` tries them in this order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..core.names import DETECTORS
from ..core.sensor import LIGHT_CANDIDATES, LIGHT_EFFECTS, Sensor
from .alternatives.alternative import Alternative
from .fitting.bundle_adjustment import Data
from .fitting.unknowns import BACKLASH, CLOCKS, DELAY, OF_DRIFT, SKEW, SPLINE, Choice
from .table import bends

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate

Sigmas = dict[str, float]
#: Effects of light that belong to the mirror's facets.
OF_FACETS = ("diffraction", "rolloff", "strips", "tip", "coating", "stains")
#: A function that returns the unknowns of an effect with their prior standard uncertainties, for a
#: sensor and samples; empty where these do not allow the effect.
Unknowns = Callable[[Sensor, Data], Sigmas]


def no_unknowns(sensor: Sensor, data: Data) -> Sigmas:
    """No unknowns, for an effect that only changes the fit's settings."""
    return {}


@dataclass(frozen=True)
class Effect(Alternative):
    """An alternative that may become a part of the model, with unknowns of its own.

    key: its name in `calibrate.effects`.  words: a noun phrase for messages.  unknowns: see
    `Unknowns`.  missing: the reason why the effect has no unknowns, such as a column that the table
    lacks; empty if that is not worth a line.  beam: standard deviation of the beam's position from
    sample to sample, mm.  of_light: whether it needs the model of real light.  coated: whether it
    needs a coating in the sensor.  tried_last: whether a trial is so expensive that all others are
    decided first.  rivals: name of a group of effects that look alike, of which the first of those
    that explain most is taken.  before: the key of `calibrate.before` that adds its unknowns to
    every fit.
    """

    unknowns: Unknowns = no_unknowns
    before: str = ""
    missing: str = ""
    beam: float = 0.0
    of_light: bool = False
    coated: bool = False
    tried_last: bool = False
    rivals: str = ""


@dataclass(frozen=True)
class Candidate:
    """An effect with the unknowns that it has for the sensor and the samples at hand."""

    effect: Effect
    sigma: Sigmas

    @property
    def key(self) -> str:
        """The key of the effect."""
        return self.effect.key


def light_unknowns(candidate: str) -> Sigmas:
    """The unknowns of one of `LIGHT_CANDIDATES`."""
    every = [effect.sigmas for effect in LIGHT_EFFECTS.values() if effect.candidate == candidate]
    return {name: sigma for sigmas in every for name, sigma in sigmas.items()}


#: Prior standard uncertainties of effects: mm, rad, s and fractions.  bend, spline: corrections of
#: a detector at its edge, up to third order and beyond.  delay: of the reference; a later one has
#: another fault.  skew: between two channels of a converter.  play, play_angle: half of a backlash.
#: lag: fraction of an axis's last step.  drift: over half a run, or per kelvin.  beam: from sample
#: to sample.
SIGMAS = {
    "bend": 0.03, "spline": 0.01, "delay": 0.01, "skew": 1e-4, "play": 2e-3, "play_angle": 1e-5,
    "lag": 0.01, "drift": 0.005, "beam": 0.01,
}  # fmt: skip


def bends_of_all() -> Sigmas:
    """The prior standard uncertainties of the bends of all detectors by name."""
    return {name: size for k in DETECTORS for name, size in bends(k, SIGMAS["bend"]).items()}


def open_bends(settings: Calibrate) -> Sigmas:
    """The bends of the detectors that a calibration need not fit, with their prior standard
    uncertainties."""
    is_decided = settings.effects.get("bend") == "off" or "bend_um" in settings.before
    return {} if is_decided else bends_of_all()


def spline_unknowns(sensor: Sensor, data: Data) -> Sigmas:
    """Bends and splines of all detectors; none if the configuration has a correction table."""
    if any(psd.correction.grid for psd in sensor.psds):  # keep a table of the configuration
        return {}
    return bends_of_all() | dict.fromkeys(SPLINE, SIGMAS["spline"])


def motion_unknowns(sigma: Sigmas) -> Unknowns:
    """Unknowns that only a motion with measured velocities determines."""

    def unknowns(sensor: Sensor, data: Data) -> Sigmas:
        """The unknowns, if the table is a motion in time, else none."""
        return {} if data.velocity is None else sigma

    return unknowns


def backlash_unknowns(sensor: Sensor, data: Data) -> Sigmas:
    """The unknowns of a backlash, of the axes that the reference measures."""
    if data.moves is None or not data.moves.approach.any():
        return {}
    measured = np.isfinite(data.sigma)
    sizes = [SIGMAS["play"]] * 3 + [SIGMAS["play_angle"]] * 3
    return {name: sizes[n] for n, name in enumerate(BACKLASH) if measured[n]}


def lag_unknowns(sensor: Sensor, data: Data) -> Sigmas:
    """The unknowns of a lag; none in a motion in time, where a lag is a delay."""
    if data.velocity is not None:
        return {}
    axes = (name.partition(".")[2] for name in backlash_unknowns(sensor, data))
    return {f"lag.{axis}": SIGMAS["lag"] for axis in axes}


def drift_unknowns(*causes: str) -> Unknowns:
    """Unknowns of a drift.  causes: regressors out of `CLOCKS`, all of which must vary."""
    columns = [CLOCKS.index(cause) for cause in causes]

    def unknowns(sensor: Sensor, data: Data) -> Sigmas:
        """The unknowns, if the columns of the clock vary, else none."""
        if data.clock is None or not np.ptp(data.clock[:, columns], axis=0).all():
            return {}
        return {f"{cause}.{what}": SIGMAS["drift"] for cause in causes for what in OF_DRIFT}

    return unknowns


def fixed_unknowns(sigma: Sigmas) -> Unknowns:
    """Make a function that returns these unknowns for every table."""
    return lambda sensor, data: sigma


EVERY_EFFECT = (
    *(
        Effect(key, "facets" if key in OF_FACETS else "light", words,
               unknowns=fixed_unknowns(light_unknowns(key)), of_light=True,
               coated=key == "coating", tried_last=key == "coating")
        for key, (_, words) in LIGHT_CANDIDATES.items()
    ),
    Effect("bend", "detectors", "detectors bent in second and third order",
           unknowns=fixed_unknowns(bends_of_all()), before="bend_um"),
    Effect("spline", "detectors", "detectors bent beyond third order", unknowns=spline_unknowns,
           tried_last=True),
    Effect("delay", "time", "a reference that is late or early",
           unknowns=motion_unknowns({DELAY: SIGMAS["delay"]}), missing="no time_s of a motion"),
    # relative to detector A, because a common delay of all three is that of the reference
    Effect("channel_skew", "time", "channels read one after the other",
           unknowns=motion_unknowns(dict.fromkeys(SKEW[1:], SIGMAS["skew"])),
           missing="no time_s of a motion"),
    Effect("backlash", "reference", "a reference with backlash", unknowns=backlash_unknowns,
           rivals="step"),
    Effect("lag", "reference", "a mirror that lags by a share of its last step",
           unknowns=lag_unknowns, rivals="step"),
    Effect("temperature_drift", "environment", "a beam, detectors drifting with heat",
           unknowns=drift_unknowns("temperature"), missing="no temperature_c", rivals="drift"),
    Effect("temperature_lag", "environment",
           "a beam, detectors following the temperature late or early",
           unknowns=drift_unknowns("past"), rivals="drift"),
    Effect("time_drift", "environment", "a beam, detectors drifting with time",
           unknowns=drift_unknowns("time"), missing="no time_s", rivals="drift"),
    Effect("beam_moves", "light", "a beam that moves from sample to sample", beam=SIGMAS["beam"]),
)  # fmt: skip


def candidates(sensor: Sensor, data: Data, settings: Calibrate) -> list[Candidate]:
    """The effects that sensor, table and settings allow."""
    allowed = []
    for effect in effects_in_use(settings):
        if effect.of_light and sensor.apertures.cut:
            continue  # the model has real light or cut light, not both
        sigma = effect.unknowns(sensor, data)
        if sigma or effect.beam:
            allowed.append(Candidate(effect, sigma))
    return allowed


def effects_in_use(settings: Calibrate) -> list[Effect]:
    """The effects that are not off."""
    return [effect for effect in EVERY_EFFECT if not is_off(effect, settings)]


def is_off(effect: Effect, settings: Calibrate) -> bool:
    """Whether an effect is switched off, or has its unknowns in every fit."""
    if effect.before in settings.before:
        return True
    return settings.effects.get(effect.key, "auto") == "off"


def effects_without_columns(every: list[Candidate], settings: Calibrate) -> list[Effect]:
    """Effects that the table has no columns for."""
    possible = {candidate.key for candidate in every}
    return [
        effect
        for effect in effects_in_use(settings)
        if effect.missing and effect.key not in possible
    ]


def add_candidate(chosen: Choice, candidate: Candidate) -> Choice:
    """The choice with the candidate's unknowns and its beam in addition."""
    return replace(
        chosen.add_unknowns(candidate.sigma), beam=max(chosen.beam, candidate.effect.beam)
    )


#: Directions of polarisation with which fits begin, rad; the period is half a turn.
POLARISATIONS = (np.pi / 4, np.pi / 2, 3 * np.pi / 4, 0.0)
#: Refractive index of aluminium at 633 nm, for a coating that the configuration does not describe.
ALUMINIUM = (1.37, 7.62)


def add_coating(sensor: Sensor, polarisation: float = POLARISATIONS[0]) -> Sensor:
    """The sensor with a coating and a polarisation, for a fit to begin with."""
    light = sensor.light
    if light.index is not None and light.polarization is not None:
        return sensor
    polarisation = polarisation if light.polarization is None else light.polarization
    index = light.index or ALUMINIUM
    return replace(sensor, light=replace(light, index=index, polarization=polarisation))
