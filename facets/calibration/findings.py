"""Findings on a fit, in sentences: causes, chi-square, outliers and pulls.

Each finding states the likely cause and what to do, and whether it forbids to use the result. A
function that returns `Finding | None` returns None if there is nothing to report.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product
from math import factorial

import numpy as np

from ..core.axis_keys import MAX_LENGTH_MM
from ..core.calibrate import Calibrate
from ..core.names import DETECTORS, KINDS, POSE
from ..core.sensor import Sensor
from ..core.settings import Solve
from ..core.units import Booleans, Floats
from ..detectors import temperature
from ..detectors.calibrated import TEMPERATURE
from ..detectors.correction import correct
from ..detectors.noise import standard_deviations
from ..estimation.plan import make_plan
from ..estimation.uncertainty import redundancies
from ..model.arrays import EFFECTS, readings, spot_size
from .alternatives.alternative import (
    MAX_LISTED_ROWS,
    Finding,
    capitalise,
    describe_pose,
    describe_rivals,
)
from .alternatives.entries import BY_KEY
from .alternatives.faults import LEAST_STRAY
from .alternatives.judge import Cause, rivals_of_shape
from .alternatives.remainder import Remainder, rise_without
from .alternatives.scatter import (
    CLOCK,
    DETECTOR_SCATTER,
    FAR_SIGMAS,
    LEAST_ERRING,
    PLACES,
    POWERS,
    SCATTER,
    SUPPLY_SCATTER,
    Scatter,
    erring_column,
    far_unknowns,
)
from .fitting.bundle_adjustment import CLEAR_SIGMAS, Data, relative_power
from .fitting.fit import Fit
from .fitting.samples import ALIKE, MOST_OUTLIER_FRACTION, row_numbers, warms_with_time
from .fitting.unknowns import BACKLASH, DELAY, LAG, PAST, PLACE, TIME_DRIFT
from .table import unit_of

#: Outliers of one coordinate in more than this fraction of the samples are no spikes.
ONE_PLACE_FRACTION = 0.03
#: A fit is not to be trusted if its residuals exceed this many times the noise.
WORST_SIGMAS = 3.0


def standardised_residuals(result: Fit) -> Floats:
    """Residuals (n, 9) relative to their own standard deviations; NaN where no other reading checks
    one."""
    scale = np.sqrt(np.where(result.redundancy > 0.01, result.redundancy, np.nan))
    out: Floats = result.residuals / scale
    return out


def residual_sizes(result: Fit, data: Data) -> Floats:
    """The standard deviations (9,) of the residuals of each reading, relative to the noise."""
    over = np.where(result.weights < 1, np.nan, standardised_residuals(result))
    over[~np.isfinite(data.raw)] = np.nan
    count = np.maximum(np.isfinite(over).sum(axis=0), 1)
    size: Floats = np.sqrt(np.nansum(over**2, axis=0) / count)
    return size


def count_outliers(result: Fit) -> int:
    """Number of samples with a reading of reduced weight."""
    return int((result.weights < 1).any(axis=1).sum())


def expected_outliers(result: Fit) -> float:
    """Expected number of samples with a reading of reduced weight if there is only noise."""
    from scipy.special import ndtr

    if not np.isfinite(result.limit):
        return 0.0
    inside = 1 - 2 * ndtr(-result.limit)
    return float(len(result.residuals) * (1 - inside ** result.residuals.shape[1]))


# ---- findings


def findings(sensor: Sensor, result: Fit, data: Data) -> list[Finding]:
    """All findings on a converged fit; those that forbid its use first."""
    every = [
        chi_square_finding(result, data),
        spike_finding(result),
        *pull_findings(sensor, result),
    ]
    every.append(power_finding(result, data))
    return sorted((finding for finding in every if finding), key=lambda finding: not finding.bad)


def effect_findings(remainder: Remainder, min_rise: float) -> list[Finding]:
    """Findings on fitted effects that a user can remove from the rig, if chi-square would rise by
    more than `min_rise` without them."""
    result = remainder.fit
    every = []
    for series, make in (
        (BACKLASH, backlash_finding), (LAG, lag_finding), (PAST, heat_lag_finding),
        (TEMPERATURE, partial(warming_finding, data=remainder.data)),
        (TIME_DRIFT, drift_finding),
        (PROFILE, partial(profile_finding, remainder=remainder)),
        (STAINS, partial(stain_finding, remainder=remainder)),
        ((DELAY,), partial(delay_finding, data=remainder.data)),
    ):  # fmt: skip
        names = [name for name in result.choice.names if name in series]
        if names and rise_without(remainder, names) > min_rise:
            every.append(make(result))
    return [finding for finding in every if finding]


def chi_square_finding(result: Fit, data: Data) -> Finding | None:
    """A finding on a chi-square that exceeds that of noise alone."""
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
        "times): the model is incomplete, and the stated uncertainties have been widened for it."
    ))  # fmt: skip


def spike_finding(result: Fit) -> Finding | None:
    """A finding on samples of reduced weight: more than by chance, or far off."""
    count, total, chance = count_outliers(result), len(result.residuals), expected_outliers(result)
    beyond, far = count - chance, int((result.weights < 0.5).any(axis=1).sum())
    if beyond < 5 * np.sqrt(chance + 1) and not far:  # far: twice the limit, which no noise reaches
        return None
    words = f"{count} of {total} samples contain an outlier ({chance:.0f} expected by chance)"
    each = (result.weights < 1).sum(axis=0)
    most = max(temperature.PLACES, key=lambda n: each[n])
    if each[most] > ONE_PLACE_FRACTION * total and each[most] > beyond / 2:
        return Finding(True, (
            f"{words}, {each[most]} of them in {KINDS[most % 3]} of detector "
            f"{DETECTORS[most // 3].upper()}: its noise is larger than the configuration says, or "
            "comes in bursts; look at its cable, plug and amplifier."
        ), ("spikes",))  # fmt: skip
    if beyond > MOST_OUTLIER_FRACTION * total:
        return Finding(True, (
            f"{words}: these are no spikes but a misfit of the model or a noise that is larger "
            "than the configuration says; find its cause before you use the result."
        ))  # fmt: skip
    return Finding(False, (
        f"{words}: spikes, which weigh less in the fit; look at cables, dust and shutters."
    ))  # fmt: skip


def pull_findings(sensor: Sensor, result: Fit, far: float = FAR_SIGMAS) -> list[Finding]:
    """A finding on unknowns that the fit moves by more than `far` prior standard uncertainties."""
    off = far_unknowns(sensor, result, far)
    if not off:
        return []
    listed = ", ".join(f"{name} ({size:.0f} times)" for name, size in off[:3])
    return [Finding(True, (
        f"The fit moves {listed} further than the uncertainty in calibrate.before allows: the "
        "configuration is not that of this rig, or a column has a wrong sign, unit or place."
    ))]  # fmt: skip


#: Relative changes of the laser's power over the run, and from sample to sample, that are reported.
POWER_CHANGE, POWER_JITTER = 2e-3, 1e-3


def power_change(result: Fit, data: Data) -> float:
    """The relative change (r.m.s.) of the laser's power during the motion, without outliers."""
    light = relative_power(data, result.own_values, result.all_values)[
        (result.weights == 1).all(axis=1)
    ]
    return float(np.std(light)) if light.size else 0.0


#: The laser counts as steady if its power changes by less than this many times the readings' noise.
STEADY = 2.0


def later_power(
    solve: Solve, settings: Calibrate, sensor: Sensor, result: Fit, data: Data
) -> tuple[Solve, list[Finding]]:
    """Return the settings for solving later readings, and findings on them.

    A known power becomes a prior if the laser changed by more than the noise of a reading.
    sensor: the calibrated one.
    """
    if solve.power != "known" or solve.method == "paper" or not settings.power_per_sample:
        return solve, []
    rest = readings(sensor, np.zeros((1, 8)))
    noise = np.linalg.norm(standard_deviations(sensor, rest)[0, 2::3]) / rest[0, 2::3].sum()
    change = power_change(result, data)
    if change < STEADY * noise:
        words = "solve.power stays known: the laser's power shows no change beyond the noise of a"
        return solve, [Finding(False, f"{words} reading ({100 * noise:.2g} %).")]
    later = replace(solve, power="prior", power_sigma=change)
    words = (
        "solve.power is changed from known to prior, because the laser's power changed by "
        f"{100 * change:.2g} % (r.m.s.), more than the noise of a reading ({100 * noise:.2g} %); "
        "that change is solve.power_sigma_percent."
    )
    plan = make_plan(sensor, later.knowledge(sensor))
    if redundancies(sensor, np.zeros((1, 8)), plan).sum() < plan.least_redundancy:
        words += (
            " Poses then have hardly any redundancy, and readings get the status unchecked. Set "
            "solve.beam to known if the beam does not move, or set solve.beam_sigma_um to the "
            "uncertainty of the beam's position."
        )
    return later, [Finding(False, words)]


def power_finding(result: Fit, data: Data) -> Finding | None:
    """A finding on changes of the laser's power: a slow drift or jitter."""
    change = power_change(result, data)
    if change < POWER_CHANGE:
        return None
    shares = result.own_values[(result.weights == 1).all(axis=1), 6]
    jitter = float(np.std(shares)) if result.choice.power else 0.0
    words = f"The laser's power changed by {100 * change:.2g} % (r.m.s.) during the motion. "
    if jitter < POWER_JITTER:
        words += "It drifted slowly, and the fit follows the drift. "
    else:
        words += (
            f"From sample to sample it jittered by {100 * jitter:.2g} %, so that the three powers "
            "determine only two ratios: x and y of this calibration are two to three times less "
            "accurate than with a steady laser, and their stated uncertainty is larger. "
        )
    return Finding(False, words.strip())


def backlash_finding(result: Fit) -> Finding | None:
    """A finding on fitted backlash of the reference."""
    return step_finding(
        result, BACKLASH, 2.0, "from side to side",
        "The reference has backlash ({}): the mirror's position depends on the direction of each "
        "axis's last step. The fit includes it; approach each pose from one side to avoid it.",
    )  # fmt: skip


def lag_finding(result: Fit) -> Finding | None:
    """A finding on a fitted lag of the mirror behind the reference."""
    return step_finding(
        result, LAG, 1.0, "of the step",
        "The mirror lags behind the reference by a fraction of its last step ({}), as if a part "
        "creeps. The fit includes it; wait longer at each pose to avoid it.",
    )  # fmt: skip


def drift_finding(result: Fit) -> Finding | None:
    """A finding on a fitted drift with time."""
    values = clear_values(result, TIME_DRIFT)
    listed = ", ".join(
        f"{name.partition('.')[2]} by {2e3 * value:.2g} um" for name, value in values.items()
    )
    if not listed:
        return None
    return Finding(False, (
        f"The beam, the detectors or the mirror on its reference drifted over the run ({listed}; "
        "bx and by are the beam's). The fit includes a straight line in time, and the result is "
        "for the middle of the run. The stated uncertainty includes half of this, and the r.m.s. "
        "distance of the beam, from which x and y are measured, from its last position. Let the "
        "rig warm up, and calibrate faster, to avoid it."
    ), ("time_drift",))  # fmt: skip


def step_finding(
    result: Fit, group: tuple[str, ...], times: float, of: str, words: str
) -> Finding | None:
    """A finding on an error after a step, by the significant unknowns of a group.

    times: the multiple of an unknown that is shown.  of: its meaning.  words: the sentence, with a
    field for the values.
    """
    sizes = []
    for name, value in clear_values(result, group).items():
        unit, factor = unit_of(name, result.sensor)
        sizes.append(f"{name.partition('.')[2]} {times * factor * value:.2g} {unit}")
    if not sizes:
        return None
    key = group[0].partition(".")[0]
    return Finding(False, words.format(f"{', '.join(sizes)} {of}"), (key,))


def delay_finding(result: Fit, data: Data) -> Finding | None:
    """A finding on a fitted delay of the reference."""
    values = clear_values(result, (DELAY,))
    if not values:
        return None
    delay = result.all_values[PLACE[DELAY]]
    words = (
        f"The reference is {'late' if delay > 0 else 'early'} by {1e3 * values[DELAY]:.3g} ms "
        "relative to the readings. The fit includes it; take both from one clock to avoid it."
    )
    if delay > 0 or not steps_follow_speed(data):
        return Finding(False, words, ("delay",))
    words += (
        " It could be that the mirror lags by a fraction of its last step, which looks the same at "
        "equal times between rows. To distinguish them: change the time between the rows."
    )
    return Finding(False, words, ("delay", "lag"))


def steps_follow_speed(data: Data) -> bool:
    """Whether the reference's last steps are proportional to its velocity."""
    if data.moves is None or data.velocity is None:
        return False
    size = np.linalg.norm(data.velocity) * np.linalg.norm(data.moves.last)
    return bool((data.velocity * data.moves.last).sum() > ALIKE * size)


def heat_lag_finding(result: Fit) -> Finding | None:
    """A finding on a fitted lag of the head behind the temperature."""
    values = clear_values(result, PAST).values()
    if not values:
        return None
    return Finding(False, (
        "The beam or the detectors follow temperature_c late (by up to "
        f"{1e3 * max(values):.2g} um for each kelvin by which they lag). The written coefficients "
        "are for a steady temperature: measure at steady temperatures, or put the thermometer on "
        "the head."
    ), ("temperature_lag",))  # fmt: skip


def warming_finding(result: Fit, data: Data) -> Finding | None:
    """A finding on fitted coefficients of a temperature that is indistinguishable from a drift."""
    values = clear_values(result, TEMPERATURE).values()
    if not values or not warms_with_time(data):
        return None
    return Finding(False, (
        "temperature_c is proportional to the time throughout the run: its effect (up to "
        f"{1e3 * max(values):.2g} um/K) cannot be distinguished from a drift, and the stated "
        "uncertainty includes that it was one. Calibrate while the temperature rises and falls."
    ), ("temperature_drift",))  # fmt: skip


#: Unknowns of a beam's profile, and of light that is lost on the facets.
PROFILE = tuple(name for name in EFFECTS if name.startswith(("profile.", "asymmetry.")))
STAINS = tuple(name for name in EFFECTS if name.startswith("stain_"))


def clear_values(
    result: Fit, group: tuple[str, ...], clear: float = CLEAR_SIGMAS
) -> dict[str, float]:
    """The magnitudes by name, in mm, rad, s or fractions, of unknowns of a group that exceed
    `clear` standard uncertainties."""
    fitted = zip(result.choice.names, np.abs(result.values), result.uncertainty, strict=True)
    return {name: float(x) for name, x, u in fitted if name in group and x > clear * u}


def profile_size(result: Fit, kind: str) -> float:
    """The r.m.s. relative deviation of the irradiance from a Gaussian by one series, weighted by
    the beam's light.

    kind: "profile" or "asymmetry". The square of He_i(x) He_j(y) has the mean i! j!.
    """
    total = 0.0
    for n, name in enumerate(result.choice.names):
        series, _, axes = name.partition(".")
        if series == kind:
            mean = factorial(axes.count("x")) * factorial(axes.count("y"))
            total += mean * float(result.values[n]) ** 2
    return float(np.sqrt(total))


def profile_finding(result: Fit, remainder: Remainder) -> Finding | None:
    """A finding on a fitted beam profile that is not Gaussian, and on alternatives to it."""
    places = [n for n, name in enumerate(result.choice.names) if name in PROFILE]
    values, sigmas = result.values[places], result.uncertainty[places]
    if not (np.abs(values) > CLEAR_SIGMAS * sigmas).any():
        return None
    listed = ", ".join(
        f"{result.choice.names[n].partition('.')[2]} {value:.2g}"
        for n, value in zip(places, values, strict=True)
    )
    size = 100 * float(np.hypot(profile_size(result, "profile"), profile_size(result, "asymmetry")))
    words = (
        f"The beam's profile is not Gaussian: its irradiance deviates by {size:.2g} % (r.m.s. over "
        f"its light; Hermite coefficients {listed}). The fit includes it to fourth order; clean "
        "the beam with a pinhole or a fibre to avoid it."
    )
    if profile_size(result, "asymmetry"):
        words += (
            " It is not symmetric, perhaps because of a second reflex: x and y may have an offset "
            "that is the same in all poses and that no reading shows; the stated uncertainty "
            "includes it."
        )
    rivals, _ = rivals_of_shape(remainder, tuple(result.choice.names[n] for n in places))
    others = [BY_KEY[trace.key] for trace in rivals]
    if others:
        words += f" It could be that {' or that '.join(part.words for part in others)} as well."
    return Finding(False, words, ("profile", *(part.key for part in others)))


def stain_finding(result: Fit, remainder: Remainder) -> Finding:
    """A finding on the facet that loses most light to dust, chips or stains."""
    at = [n for n, name in enumerate(result.choice.names) if name in STAINS]
    effect = remainder.likelihood.common[:, :, at] @ result.values[at]
    lost = np.nanmax(-effect[:, 2::3] / remainder.light, axis=0)
    k = int(np.argmax(lost))
    return Finding(False, (
        f"Facet {DETECTORS[k].upper()} loses up to {100 * lost[k]:.2g} % of its light to dust, "
        "chips or stains. The fit follows that as a smooth function of x and y "
        "(sensor.light.stains); clean the mirror, or take another one, to be rid of it."
    ), ("stains",))  # fmt: skip


def scatter_findings(scatter: Scatter, min_fall: float) -> list[Finding]:
    """A finding on the cause of the scatter from sample to sample, and on the alternatives, if it
    lowers -2 log L by more than `min_fall`."""
    if not scatter.causes or scatter.fall < min_fall:
        return []
    sizes = {
        "reference_scatter": describe_reference,
        "beam_scatter": describe_beam,
        "detector_scatter": describe_detectors,
        "supply_scatter": describe_places,
        "clock_scatter": describe_clock,
    }
    words = "; and ".join(sizes[key](scatter) for key in scatter.causes)
    keys = [
        DETECTOR_SCATTER if key == SUPPLY_SCATTER and not scatter.is_shared else key
        for key in scatter.causes
    ]
    rivals = [key for key in scatter.others if key not in keys]
    others = " or ".join(SCATTER[key].words for key in rivals)
    measurements = "; ".join(SCATTER[key].measurement for key in (*keys, *rivals))
    rest = (
        f" It could be {others} as well: these samples cannot tell. To distinguish them: "
        f"{measurements}." if others else ""
    )  # fmt: skip
    return [Finding(False, (
        "The samples scatter by more than the stated noise. The likeliest cause: "
        f"{words}.{rest} The fit and the stated uncertainties of its parameters include this "
        "scatter."
    ), (*keys, *rivals))]  # fmt: skip


def cause_findings(causes: list[Cause]) -> list[Finding]:
    """Findings on the causes of the residuals, one for each alternative that is the likeliest."""
    first = {cause.best.key: cause for cause in reversed(causes)}
    return [cause_finding(cause) for cause in causes if first[cause.best.key] is cause]


def cause_finding(cause: Cause) -> Finding:
    """A finding on the cause of a part of the residuals that no unknown explains."""
    clauses = cause.clauses
    several, best = cause.alternatives, cause.alternatives[0]
    words = (
        f"Residuals of {cause.size:.2g} times the noise (r.m.s.) have another cause than the "
        "fitted effects. "
        + (f"The likeliest cause: {clauses[0]}." if len(several) == 1
           else describe_rivals(several, clauses))
        + f" {capitalise(best.remedy)}, and calibrate again."
    )  # fmt: skip
    if not cause.refuses:
        words += (
            f" It moves poses by up to {cause.shift:.2g} times their stated uncertainty, which "
            "includes this."
        )
    return Finding(cause.refuses, words, tuple(part.key for part in several))


def describe_reference(scatter: Scatter) -> str:
    """The further error of the reference in words."""
    return (
        f"the reference errs by a further {describe_pose(scatter.sizes[:6])} (r.m.s.) in addition "
        "to calibrate.reference, or the mirror vibrates against it by as much"
    )


def describe_clock(scatter: Scatter) -> str:
    """The jitter of the reference's times in words."""
    return (
        f"the times of the reference jitter by {1e3 * scatter.size_of(CLOCK):.2g} ms (r.m.s.) "
        "against the readings; take both from one clock, or let one trigger the other"
    )


def describe_beam(scatter: Scatter) -> str:
    """The motion of the beam from sample to sample in words."""
    return (
        f"the beam moved by {1e3 * scatter.size_of('beam'):.2g} um (r.m.s.) from sample to sample; "
        "if it moves as much when poses are measured, set solve.beam to prior and beam_sigma_um to "
        "this, since x and y err by as much if the beam is taken as known"
    )


def describe_detectors(scatter: Scatter) -> str:
    """The further scatter of the readings in words."""
    places, powers = (float(np.hypot(1.0, scatter.size_of(name))) for name in (PLACES, POWERS))
    return (
        f"the readings scatter by {places:.3g} times the stated noise in places and {powers:.3g} "
        "times in powers, by the detectors' noise or by other light on them, such as a lamp; "
        "measure with facets noise, also in the dark"
    )


def describe_places(scatter: Scatter) -> str:
    """Describe the scatter of the places on each detector, and whether they scatter together."""
    sizes = np.sqrt(1 + np.diag(scatter.places).reshape(3, 2).mean(axis=1)).tolist()
    listed = ", ".join(f"{size:.3g}" for size in sizes)
    together = (
        "together, as by a supply or a reference voltage that they share" if scatter.is_shared
        else "each by itself, as by their own noise or by warm air in the beams' paths"
    )  # fmt: skip
    return (
        f"the places on A, B and C scatter by {listed} times the stated noise, {together}, and the "
        f"powers by {np.hypot(1.0, scatter.size_of(POWERS)):.3g} times"
    )


def outlier_findings(
    sensor: Sensor, data: Data, rows: list[int], result: Fit, kind: str
) -> list[Finding]:
    """A finding on samples that were excluded, and on what they have in common.

    data: all samples.  rows: the numbers of the excluded ones.  kind: what is numbered, rows or
    dwells.
    """
    if not rows:
        return []
    listed = ", ".join(str(row) for row in rows[:MAX_LISTED_ROWS])
    more = f" and {len(rows) - MAX_LISTED_ROWS} more" if len(rows) > MAX_LISTED_ROWS else ""
    excluded = np.isin(row_numbers(data), rows)
    common, cause = common_of_outliers(sensor, data, excluded, result)
    return [Finding(False, (
        f"{len(rows)} of {len(data.raw)} samples contain an outlier that noise does not explain "
        f"and were excluded ({kind} {listed}{more}){common}"
    ), (cause,))]  # fmt: skip


#: The cause of excluded samples if something covers a part of a detector.
SHADED = "shaded"


def common_of_outliers(
    sensor: Sensor, data: Data, excluded: Booleans, result: Fit
) -> tuple[str, str]:
    """Describe what excluded samples (n,) have in common; return the words and the cause's key."""
    rows = np.flatnonzero(excluded)
    if len(rows) >= LEAST_STRAY and np.ptp(rows) < 2 * len(rows):
        return (
            ". They follow each other: see whether these rows belong to the others, and whether "
            "something was in the light.", "outlier_rows",
        )  # fmt: skip
    if side := shaded_side(result.sensor, data, excluded):
        return describe_shade(*side), SHADED
    place = erring_column(sensor, data.part(excluded), result)
    if place is None:
        return ": look at cables, dust, shutters and the reference there.", "outliers"
    if place in POSE:
        return (
            f". In most of them the reference's {place} errs: look at it, and at its digits in the "
            "table.", "reference_outliers",
        )  # fmt: skip
    return (
        f". In most of them {place} errs: look at that detector's cable, and at the digits.",
        "reading_outliers",
    )


def describe_shade(n: int, sign: int, limit: float) -> str:
    """Describe the shaded side of a detector; see `shaded_side`."""
    letter = DETECTORS[n // 3]
    return (
        f". They are all where {KINDS[n % 3]} of detector {letter.upper()} is "
        f"{'over' if sign > 0 else 'under'} {sign * limit:.2g} mm: something may be in the "
        "light there; look at that detector's housing and window. In the result, spots there and "
        f"up to half a beam's diameter before are out of range (sensor.psd.{letter}.usable_mm)."
    )


def shaded_side(sensor: Sensor, data: Data, excluded: Booleans) -> tuple[int, int, float] | None:
    """The side of a detector that contains all spots of the excluded samples (n,), and few others;
    None if there is none.

    Returns the index of a coordinate in a reading, 1 or -1 for its upper or lower side, and the
    least excluded coordinate, times that sign, mm.
    """
    if excluded.sum() < LEAST_ERRING:
        return None
    places = correct(sensor, data.raw)
    for n, sign in product(temperature.PLACES, (-1, 1)):
        place = sign * places[:, n]
        limit = float(place[excluded].min())  # NaN if one of them has no such spot
        if np.isfinite(limit) and 4 * np.sum(place[~excluded] > limit) < excluded.sum():
            return n, sign, limit
    return None


def exclude_shade(result: Fit, data: Data, rows: list[int]) -> Sensor:
    """The fitted sensor with the shaded side of a detector out of range.

    The limit is half a beam's diameter before the spots of excluded rows, which are cut less there.
    """
    sensor = result.sensor
    side = shaded_side(sensor, data, np.isin(row_numbers(data), rows))
    if side is None:
        return sensor
    n, sign, limit = side
    ends = sorted((-sign * MAX_LENGTH_MM, sign * (limit - spot_size(sensor) / 2)))
    psds = list(sensor.psds)
    psds[n // 3] = psds[n // 3].limit(n % 3, *ends)
    return replace(sensor, psds=(psds[0], psds[1], psds[2]))


def centre_findings(centre: float) -> list[Finding]:
    """A finding on a common offset of x and y, which no residual shows.  centre: the standard
    uncertainty of the light's centre, mm."""
    if not centre:
        return []
    return [Finding(False, (
        f"x and y of all poses may be off together by {1e3 * centre:.2g} um (standard uncertainty, "
        "included in the stated one), because a faint second reflex, a beam that is not quite "
        "Gaussian or a chipped tip moves the light's centre without a residual. Differences of x "
        "and y do not have this error (calibrate.before.beam_profile_percent)."
    ))]  # fmt: skip
