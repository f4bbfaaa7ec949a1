"""Findings on a fit: chi-square, outliers, patterns and pulls, in sentences.

A model that lacks an effect leaves residuals larger than the noise, mostly in a pattern: of one
detector, of one reading, along a place, the time or an axis. Each finding is a sentence with the
likely cause and what to do, and says whether it forbids to use the result.
"""

from __future__ import annotations

from dataclasses import replace
from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.names import DETECTORS, POSE
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.calibrated import LIGHT_CENTRE, MISFIT, MODEL_ERROR
from ..model.arrays import EFFECTS
from .bundle_adjustment import Data, deviations, relative_power
from .fit import Fit
from .outliers import MOST_OUTLIER_SHARE, PLACE_SIGMA_MM, model_accuracy
from .scatter import (
    FAR_SIGMAS,
    PLACES,
    POWERS,
    Scatter,
    far_unknowns,
    is_doubtful,
)
from .spline import spline_error
from .table import unit_of
from .unknowns import BACKLASH, CLOCKS, LAG, PAST
from .unmodelled import Remainder, uneven_share

if TYPE_CHECKING:
    from ..core.calibrate import Calibrate

KINDS = ("psi", "zeta", "power")
#: The residuals' spread, over the noise, beyond which nothing may be built on a fit.
WORST_SIGMAS = 3.0
#: The chance of a pattern, below which it is told; bins that it is looked for in.
PATTERN_CHANCE, PATTERN_BINS = 1e-6, 8


class Finding(NamedTuple):
    """A finding.  bad: whether it forbids to use the calibration.  words: a whole sentence."""

    bad: bool
    words: str


class Pattern(NamedTuple):
    """Residuals of a reading that depend on a variable.  strength: chi-square over its bins."""

    strength: float
    detector: str
    kind: str
    along: str
    size: float


def standardised_residuals(result: Fit) -> Floats:
    """Residuals (n, 9) over their own standard deviations; NaN where no other reading checks
    one."""
    scale = np.sqrt(np.where(result.redundancy > 0.01, result.redundancy, np.nan))
    out: Floats = result.residuals / scale
    return out


def residual_sizes(result: Fit, data: Data) -> Floats:
    """The standard deviation of each of the nine readings' residuals over the noise (9,)."""
    over = np.where(result.weights < 1, np.nan, standardised_residuals(result))
    over[~np.isfinite(data.raw)] = np.nan
    count = np.maximum(np.isfinite(over).sum(axis=0), 1)
    size: Floats = np.sqrt(np.nansum(over**2, axis=0) / count)
    return size


def count_outliers(result: Fit) -> int:
    """Number of samples with a reading of reduced weight."""
    return int((result.weights < 1).any(axis=1).sum())


def expected_outliers(result: Fit) -> float:
    """Number of samples with a reading of reduced weight that noise alone makes."""
    from scipy.special import ndtr

    if not np.isfinite(result.limit):
        return 0.0
    inside = 1 - 2 * ndtr(-result.limit)
    return float(len(result.residuals) * (1 - inside ** result.residuals.shape[1]))


# ---- patterns


def patterns(result: Fit, data: Data) -> list[Pattern]:
    """Significant dependences of the residuals, the clearest first; one for each reading."""
    from scipy.special import chdtri

    over = np.where(result.weights < 1, np.nan, standardised_residuals(result))
    over[~np.isfinite(data.raw)] = np.nan
    limit = float(chdtri(PATTERN_BINS, PATTERN_CHANCE))
    best: dict[tuple[str, str], Pattern] = {}
    for n in range(9):
        letter, kind = DETECTORS[n // 3].upper(), KINDS[n % 3]
        for along, values in pattern_variables(data, n // 3).items():
            strength, size = bin_residuals(over[:, n], values)
            if strength > limit and strength > best.get((letter, kind), NO_PATTERN).strength:
                best[letter, kind] = Pattern(strength, letter, kind, along, size)
    return sorted(best.values(), reverse=True)


NO_PATTERN = Pattern(0.0, "", "", "", 0.0)


def pattern_variables(data: Data, k: int) -> dict[str, Floats]:
    """The variables on which the residuals of detector k may depend, by name."""
    variables: dict[str, Floats] = {
        "the spot's place along psi": data.raw[:, 3 * k],
        "the spot's place along zeta": data.raw[:, 3 * k + 1],
        "the power": data.raw[:, 3 * k + 2],
    }
    for n, name in enumerate(POSE):
        variables[f"the reference's {name}"] = data.pose[:, n]
    if data.velocity is not None:
        for n, name in enumerate(POSE):
            variables[f"the speed of {name}"] = data.velocity[:, n]
    clock = np.zeros((len(data.raw), len(CLOCKS))) if data.clock is None else data.clock
    time: Floats = clock[:, 0] if clock[:, 0].any() else np.linspace(-1, 1, len(data.raw))
    variables["the time"] = time
    if clock[:, 1].any():
        variables["the temperature"] = clock[:, 1]
    return variables


def bin_residuals(over: Floats, along: Floats) -> tuple[float, float]:
    """Chi-square of the means in bins of equal counts, and the largest mean, in noise's units."""
    there = np.isfinite(over) & np.isfinite(along)
    if there.sum() < 4 * PATTERN_BINS or np.ptp(along[there]) == 0:
        return 0.0, 0.0
    order = np.argsort(along[there], kind="stable")
    spread = float(np.std(over[there])) or 1.0
    means = [(part.mean(), len(part)) for part in np.array_split(over[there][order], PATTERN_BINS)]
    strength = sum(count * (mean / max(spread, 1.0)) ** 2 for mean, count in means)
    return float(strength), float(max(abs(mean) for mean, _ in means))


CAUSES = {
    "psi": "the detector is not linear there, or an edge or its window bends the light",
    "zeta": "the detector is not linear there, or an edge or its window bends the light",
    "power": "its gain or the light's losses change there",
}


def cause_of(pattern: Pattern) -> str:
    if "time" in pattern.along:
        return "something drifts: the beam, a detector's post, the laser or the reference"
    if "temperature" in pattern.along:
        return "something expands; let calibrate.effects.temperature_drift be on"
    if "speed" in pattern.along:
        return "readings and reference are not of the same moment, or their clocks run apart"
    if "reference" in pattern.along:
        return "the reference's axes or scale are not what they are said to be, or a facet is bent"
    return CAUSES[pattern.kind]


# ---- findings


def findings(sensor: Sensor, result: Fit, data: Data, scatter: Scatter) -> list[Finding]:
    """All findings on a fit that has settled; those that forbid its use first."""
    every = [
        chi_square_finding(result, data),
        spike_finding(result),
        *pull_findings(sensor, result),
    ]
    every += [pattern_finding(pattern) for pattern in patterns(result, data)[:3]]
    every += [
        scatter_finding(scatter),
        backlash_finding(result),
        lag_finding(result),
        heat_lag_finding(result),
        profile_finding(result),
        power_finding(result, data),
    ]
    return sorted((finding for finding in every if finding), key=lambda finding: not finding.bad)


def chi_square_finding(result: Fit, data: Data) -> Finding | None:
    """A finding on a chi-square that is larger than that of noise alone."""
    if result.excess == 0:
        return None
    sizes = residual_sizes(result, data)
    worst = int(np.argmax(sizes))
    where = f"{KINDS[worst % 3]} of detector {DETECTORS[worst // 3].upper()}"
    root = float(np.sqrt(result.reduced_chi_square))
    if root > WORST_SIGMAS:
        return Finding(True, (
            f"The residuals are {root:.3g} times the noise, most in {where} ({sizes[worst]:.3g} "
            "times): the model does not describe these readings. See which of the faults below "
            "would explain it; check signs, units, the detectors' order and the configuration."
        ))  # fmt: skip
    return Finding(False, (
        f"The residuals are {root:.3g} times the noise, most in {where} ({sizes[worst]:.3g} "
        "times): the model misses something, and the stated uncertainties have been widened for it."
    ))  # fmt: skip


def spike_finding(result: Fit) -> Finding | None:
    """A finding on samples of reduced weight: too many for chance, or far off."""
    count, total, chance = count_outliers(result), len(result.residuals), expected_outliers(result)
    beyond, far = count - chance, int((result.weights < 0.5).any(axis=1).sum())
    if beyond < 5 * np.sqrt(chance + 1) and not far:  # far: twice the limit, where chance has none
        return None
    share = beyond / total
    words = f"{count} of {total} samples hold an outlier ({chance:.0f} would by chance)"
    if share > MOST_OUTLIER_SHARE:
        return Finding(True, (
            f"{words}: these are no spikes but a misfit of the model or a noise that is larger "
            "than the configuration says; find its cause before you use the result."
        ))  # fmt: skip
    return Finding(False, (
        f"{words}: spikes, which weigh less in the fit; look at cables, dust and shutters."
    ))  # fmt: skip


def pull_findings(sensor: Sensor, result: Fit, far: float = FAR_SIGMAS) -> list[Finding]:
    """A finding on unknowns that the fit moves by more than `far` times their prior uncertainty."""
    off = far_unknowns(sensor, result, far)
    if not off:
        return []
    told = ", ".join(f"{name} ({size:.0f} times)" for name, size in off[:3])
    return [Finding(True, (
        f"The fit moves {told} further than the uncertainty in calibrate.before allows: the "
        "configuration is not that of this rig, or a column has a wrong sign, unit or place."
    ))]  # fmt: skip


def pattern_finding(pattern: Pattern) -> Finding:
    return Finding(False, (
        f"The residuals of {pattern.kind} of detector {pattern.detector} follow {pattern.along}, "
        f"by up to {pattern.size:.2g} times the noise: {cause_of(pattern)}."
    ))  # fmt: skip


#: Change of the laser's power over the run, and from sample to sample, that is worth a sentence.
POWER_CHANGE, POWER_JITTER = 2e-3, 1e-3


def power_finding(result: Fit, data: Data) -> Finding | None:
    """A finding on changes of the laser's power: a slow drift or jitter."""
    light = relative_power(data, result.own_values, result.all_values)[
        (result.weights == 1).all(axis=1)
    ]
    change = float(np.std(light)) if light.size else 0.0
    if change < POWER_CHANGE:
        return None
    shares = result.own_values[(result.weights == 1).all(axis=1), 6]
    jitter = float(np.std(shares)) if result.choice.power else 0.0
    words = f"The laser's power changed by {100 * change:.2g} % (r.m.s.) during the motion. "
    if jitter < POWER_JITTER:
        words += "It drifted slowly, and the fit follows the drift. "
    else:
        words += (
            f"From sample to sample it jittered by {100 * jitter:.2g} %, so that three powers hold "
            "two shares only: x and y of this calibration are two to three times less accurate "
            "than with a steady laser, and their stated uncertainty is larger, too. "
        )
    return Finding(False, words + "Solve with solve.power: unknown, or a prior.")


def backlash_finding(result: Fit) -> Finding | None:
    """A finding on the reference's backlash, if it was fitted."""
    return step_finding(
        result, BACKLASH, 2.0, "from side to side",
        "The reference has backlash ({}): by the direction of each axis's last step the mirror was "
        "elsewhere than it says. The fit follows it; approach each pose from one side to be rid of "
        "it.",
    )  # fmt: skip


def lag_finding(result: Fit) -> Finding | None:
    """A finding on a mirror that lags behind the reference, if that was fitted."""
    return step_finding(
        result, LAG, 1.0, "of the step",
        "The mirror lags behind the reference by a share of its last step ({}), as a part that "
        "creeps. The fit follows it; wait longer at each pose to be rid of it.",
    )  # fmt: skip


def step_finding(
    result: Fit, group: tuple[str, ...], times: float, of: str, words: str
) -> Finding | None:
    """A finding on how far the mirror lags after a step, by those unknowns of a group that are
    clear.

    times: the shown multiple of an unknown.  of: its meaning.  words: with a place for the values.
    """
    told = []
    for name, value in clear_values(result, group).items():
        unit, factor = unit_of(name, result.sensor)
        told.append(f"{name.partition('.')[2]} {times * factor * value:.2g} {unit}")
    return Finding(False, words.format(f"{', '.join(told)} {of}")) if told else None


def heat_lag_finding(result: Fit) -> Finding | None:
    """A finding on a head that follows the temperature late, if that was fitted."""
    values = clear_values(result, PAST, 0.0).values()
    if not values:
        return None
    return Finding(False, (
        "The beam or the detectors follow temperature_c late (by up to "
        f"{1e3 * max(values):.2g} um for each kelvin by which they lag). What is written is what a "
        "steady temperature does: measure at steady temperatures, or put the thermometer on the "
        "head."
    ))  # fmt: skip


#: Standard uncertainties from which on a backlash, or a profile, is told.
CLEAR_SIGMAS = 4.0


def clear_values(
    result: Fit, group: tuple[str, ...], clear: float = CLEAR_SIGMAS
) -> dict[str, float]:
    """The magnitudes of those unknowns of a group that are larger than `clear` uncertainties."""
    fitted = zip(result.choice.names, np.abs(result.values), result.uncertainty, strict=True)
    return {name: float(x) for name, x, u in fitted if name in group and x > clear * u}


def profile_size(result: Fit, kind: str) -> float:
    """The r.m.s. deviation of the irradiance from a Gaussian, over the beam's light, that a series
    makes.

    kind: "profile" or "asymmetry". The square of He_i(x) He_j(y) has the mean i! j!.
    """
    total = 0.0
    for n, name in enumerate(result.choice.names):
        series, _, axes = name.partition(".")
        if series == kind:
            mean = factorial(axes.count("x")) * factorial(axes.count("y"))
            total += mean * float(result.values[n]) ** 2
    return float(np.sqrt(total))


def profile_finding(result: Fit) -> Finding | None:
    """A finding on a beam that is not Gaussian, where the fit includes its shape."""
    series = ("profile.", "asymmetry.")
    places = [n for n, name in enumerate(result.choice.names) if name.startswith(series)]
    values, sigmas = result.values[places], result.uncertainty[places]
    if not (np.abs(values) > CLEAR_SIGMAS * sigmas).any():
        return None
    listed = ", ".join(
        f"{result.choice.names[n].partition('.')[2]} {value:.2g} +- {sigma:.1g}"
        for n, value, sigma in zip(places, values, sigmas, strict=True)
    )
    size = 100 * float(np.hypot(profile_size(result, "profile"), profile_size(result, "asymmetry")))
    words = (
        f"The beam's profile is not Gaussian: its irradiance deviates by {size:.2g} % (r.m.s. over "
        f"its light; Hermite coefficients {listed}). The fit follows it to fourth order; clean the "
        "beam with a pinhole or a fibre to be rid of it."
    )
    if profile_size(result, "asymmetry"):
        words += (
            " It is not symmetric, perhaps by a second reflex: x and y may have an offset that is "
            "the same in all poses and that no reading shows; the stated uncertainty includes it."
        )
    return Finding(False, words)


#: The names of `CAUSES` in a sentence.
CAUSE_WORDS = {
    "reference": "the reference, or a mirror that vibrates against it",
    "beam": "a beam that moves",
    "detectors": "the detectors",
}


def scatter_finding(scatter: Scatter) -> Finding | None:
    """A finding on the cause of the scatter from sample to sample, and on the alternatives."""
    if not scatter.causes:
        return None
    causes = {
        "reference": describe_reference,
        "beam": describe_beam,
        "detectors": describe_detectors,
    }
    words = "; and ".join(causes[key](scatter) for key in scatter.causes)
    others = " or ".join(CAUSE_WORDS[key] for key in scatter.others)
    rest = f" It could be {others} as well: these samples cannot tell." if others else ""
    return Finding(False, (
        "The samples scatter by more than the stated noise. The likeliest cause: "
        f"{words}.{rest} The fit has this scatter in it, and so have the stated uncertainties of "
        "its parameters."
    ))  # fmt: skip


def describe_reference(scatter: Scatter) -> str:
    """The axes whose additional error is a fifth of the largest of its kind, or more."""
    told = []
    for axes, factor, unit in ((slice(0, 3), 1e3, "um"), (slice(3, 6), 1e6, "urad")):
        sizes = scatter.sizes[axes]
        told += [
            f"{factor * size:.2g} {unit} in {name}"
            for name, size in zip(POSE[axes], sizes, strict=True)
            if size > 0.2 * sizes.max()
        ]
    return (
        f"the reference errs by a further {', '.join(told)} (r.m.s.) beside what "
        "calibrate.reference says, or the mirror vibrates against it by as much"
    )


def describe_beam(scatter: Scatter) -> str:
    return (
        f"the beam moved by {1e3 * scatter.size_of('beam'):.2g} um (r.m.s.) from sample to sample; "
        "if it moves as much when poses are measured, say so with solve.beam: prior and this as "
        "beam_sigma_um, since x and y err by as much where the beam is taken as known"
    )


def describe_detectors(scatter: Scatter) -> str:
    places, powers = (float(np.hypot(1.0, scatter.size_of(name))) for name in (PLACES, POWERS))
    return (
        f"the readings scatter by {places:.3g} times the stated noise in places and {powers:.3g} "
        "times in powers, by the detectors' noise or by other light on them, such as a lamp; "
        "measure with facets noise, also in the dark"
    )


def outlier_findings(rows: list[int], total: int, kind: str) -> list[Finding]:
    """A finding on samples that were excluded.  kind: what their numbers count."""
    if not rows:
        return []
    listed = ", ".join(str(row) for row in rows[:MOST_ROWS_LISTED])
    more = f" and {len(rows) - MOST_ROWS_LISTED} more" if len(rows) > MOST_ROWS_LISTED else ""
    return [Finding(False, (
        f"{len(rows)} of {total} samples hold an outlier that no noise makes and were excluded "
        f"({kind} {listed}{more}): look at cables, dust, shutters and the reference there."
    ))]  # fmt: skip


#: How many rows a sentence lists.
MOST_ROWS_LISTED = 12


# ---- what the model misses becomes part of the uncertainty


def model_error(result: Fit, data: Data, sensor: Sensor, scatter: Scatter) -> dict[str, float]:
    """Standard deviations of what the model misses in the readings, by name, mm and mW.

    MISFIT: what the residuals show beyond chance, of a cause that is not known, and what a
    detector's spline leaves open.  MODEL_ERROR: of the model of real light itself.

    The unknowns take up a part of it, as they do of the noise, and a larger one, since what a model
    misses changes smoothly from pose to pose: what is seen is put up by the share of noise that
    stays in the residuals once more.
    """
    sigma = np.nanmedian(deviations(sensor, data), axis=0)
    more = np.array([scatter.size_of(PLACES), scatter.size_of(PLACES), scatter.size_of(POWERS)] * 3)
    missed = sigma * more / np.hypot(1.0, more)  # what the detectors scatter beside their noise
    if is_doubtful(result):
        sizes = residual_sizes(result, data)
        share = float(result.redundancy[np.isfinite(data.raw)].mean())
        missed = np.hypot(missed, sigma * np.sqrt(np.maximum(sizes**2 - 1, 0.0) / max(share, 0.1)))
    missed = np.hypot(
        missed, spline_error(sensor, data.raw, result.choice.names, result.covariance)
    )
    exact = np.zeros(9)
    if any(name in EFFECTS for name in result.choice.names):
        exact = model_accuracy(data, PLACE_SIGMA_MM)
    named = zip((*MISFIT, *MODEL_ERROR), (*missed, *exact), strict=True)
    return {name: float(size) for name, size in named if size > 0}


#: Shift of the light's middle, over the beam's standard deviation, for each unit of the share that
#: `uneven_share` gives. Of ghosts of a thousandth it gives 0.3 to 0.6, and they moved x and y of
#: calibrations by 0.5 to 1.4 of their share (the study `disturbed_rigs`).
CENTRE_PER_SHARE = 1.5
#: The same for each unit of an asymmetric beam's mean deviation from a Gaussian: another reflex,
#: 1 to 2.5 of the beam's standard deviations away, moves the middle by 2.4 to 0.4 times as much.
CENTRE_PER_ASYMMETRY = 1.5


def centre_sigma(sensor: Sensor, remainder: Remainder, settings: Calibrate) -> float:
    """Standard uncertainty of the light's middle in each direction, mm.

    The fit takes a small deviation from its cross-section, Gaussian or with the coefficients that
    it found, for another position of the apex; the residuals show little of it, and bound it. Light
    without any effect of a bench is taken to be Gaussian.
    """
    if not any(name in EFFECTS for name in remainder.fit.choice.names):
        return 0.0
    share = settings.before.get("beam_profile_percent", 0.0) / 100
    share = CENTRE_PER_SHARE * uneven_share(remainder, share) if share else 0.0
    beam_sigma = float(np.sqrt(sensor.beam.diameter_x * sensor.beam.diameter_y)) / 4
    asymmetry = CENTRE_PER_ASYMMETRY * profile_size(remainder.fit, "asymmetry")
    return beam_sigma * float(np.hypot(share, asymmetry))


def covariance_factor(result: Fit) -> float:
    """The factor of a fit's covariance in the written one: chi-square where it is in doubt."""
    return result.reduced_chi_square if is_doubtful(result) else 1.0


#: Standard deviations of chance from which on readings are taken to scatter together.
TOGETHER_SIGMAS = 4.0


def common_scatter(remainder: Remainder) -> dict[str, float]:
    """Standard deviations by which the three detectors' places scatter together, by kind, mm.

    A score test: what P y follows, see `unmodelled`, against what independent noise leaves there.
    A mirror that vibrates against the reference does the same, so the reference's stated
    uncertainty counts.
    """
    sigmas, at = {}, remainder.restricted
    for m, kind in enumerate(KINDS[:2]):
        column = remainder.is_read[:, m::3].astype(float)  # in standard deviations of the noise
        seen = (column * at.pulled[:, m::3]).sum(axis=1) ** 2
        across = (column[:, :, None] * at.weighted[:, m::3]).sum(axis=1)
        due = np.einsum("ni,nij,nj->n", column, at.inverse[:, m::3, m::3], column)
        due -= ((across @ remainder.covariance) * across).sum(axis=1)
        excess, size = float((seen - due).sum()), float((due**2).sum())
        if excess > TOGETHER_SIGMAS * np.sqrt(2 * size):
            sigma = float(np.nanmedian(remainder.noise[:, m::3]))
            sigmas[kind] = sigma * float(np.sqrt(excess / size))
    return sigmas


def common_findings(common: dict[str, float]) -> list[Finding]:
    return [Finding(False, (
        f"The three detectors' {kind} scatter together, by {1e3 * size:.2g} um (r.m.s.): a supply "
        "or a reference voltage that they share, or a mirror that vibrates; facets noise at rest "
        "tells which. The stated uncertainties include it."
    )) for kind, size in common.items()]  # fmt: skip


def add_unseen_errors(
    sensor: Sensor, result: Fit, missed: dict[str, float], centre: float, common: dict[str, float]
) -> Sensor:
    """The calibrated sensor whose uncertainty includes what the model misses in readings (`missed`,
    by name), the uncertainty of the light's middle (`centre`, mm), and what places of all detectors
    have in common (see `common_scatter`)."""
    known = sensor.calibration
    assert known is not None
    together = {kind: [f"misfit_{k}.{kind}" for k in DETECTORS] for kind in common}
    missed = dict.fromkeys((name for names in together.values() for name in names), 0.0) | missed
    if centre:
        missed = missed | dict.fromkeys(LIGHT_CENTRE, centre)
    if not missed:
        return sensor
    factor, size = covariance_factor(result), len(known.names)
    matrix = np.zeros((size + len(missed),) * 2)
    matrix[:size, :size] = factor * np.array(known.covariance)
    matrix[range(size, len(matrix)), range(size, len(matrix))] = np.square(list(missed.values()))
    names = (*known.names, *missed)
    for kind, group in together.items():
        matrix[np.ix_(*[[names.index(name) for name in group]] * 2)] += common[kind] ** 2
    joint = replace(known, names=names, covariance=tuple(map(tuple, matrix.tolist())))
    return replace(sensor, calibration=joint)
