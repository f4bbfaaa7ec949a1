"""How uncertain the mean of several samples is, and the difference of two poses.

With N the covariance of one sample's noise, P that of the priors of beam and power, C that of the
calibrated parameters and G the derivatives of a solved state by these, a mean over n samples has
the covariance

    N / n + P + G C G'

and the difference of two such means, at the states 1 and 2,

    N_1 / n_1 + N_2 / n_2 + P_1 + P_2 + (G_2 - G_1) C (G_2 - G_1)'

The parameters are off by the same at both states; the priors' errors are taken to be independent.
What the residuals of a calibration show beyond its noise (`MISFIT`) has an unknown cause, and is
taken to have no covariance from one state to another, so that a difference has it twice. What the
model itself errs by (`MODEL_ERROR`) hardly changes over short ways: its covariance between two
states is its variance times exp(-d^2 / 2), with d the shifts of the spot and of the apex beside
the beam, over `SPOT_LENGTH_MM` and `APEX_LENGTH_MM`.

The displacement of an object from a zero pose follows both poses by the derivatives A_1 and A_2 of
the composed motion. They take the place of -1 and 1: the calibration's part is
(A_1 G_1 + A_2 G_2) C (A_1 G_1 + A_2 G_2)'.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.arguments import check_arguments
from ..core.errors import InputError
from ..core.knowledge import BeamKnowledge, Knowledge, PowerKnowledge
from ..core.sensor import Sensor
from ..core.units import Booleans, Floats
from ..detectors.calibrated import MISFIT, MODEL_ERROR
from ..model.arrays import as_rows, as_vectors
from .plan import Plan, make_plan
from .solution import frame_like, root_of_diagonal
from .uncertainty import Propagation, carry_over, propagate, slices_of

if TYPE_CHECKING:
    from ..core.sensor import Calibration

#: Shifts of a spot on its detector, and of the apex beside the beam, over which the error of the
#: model of real light hardly changes: so short that 95 % of the steps of 28
#: rigs that were read by rays lay within their intervals.
SPOT_LENGTH_MM, APEX_LENGTH_MM = 0.3, 0.05


@check_arguments
def mean_uncertainty(
    sensor: Sensor,
    states: ArrayLike,
    samples: int,
    *,
    beam: BeamKnowledge = "free",
    power: PowerKnowledge = "known",
) -> Any:
    """Compute the standard uncertainty of the mean of several samples at one pose.

    Parameters
    ----------
    sensor
        The sensor; with `Sensor.calibration` the calibration's part is in the result.
    states
        States, (..., 8); mm and rad, world frame: the means, such as those of `Solution.state`.
    samples
        Number of samples in each mean, 1 or more. Their noise must be independent: samples that
        come faster than the electronics' bandwidth allows count as fewer.
    beam, power
        What was known of them, as for `facets.solve`; of a `Prior` its sigma alone counts.

    Returns
    -------
    ndarray or DataFrame
        (..., 8), mm and rad: one standard deviation. NaN where a state is not finite or a detector
        has no reading. Of a data frame the columns u_tx_mm, ..., u_yaw_mrad, ... with its index.

    Raises
    ------
    InputError
        If an argument has a wrong shape or value.

    Notes
    -----
    The variance is that of the noise over the number of samples, and those of the priors and of the
    calibration, which stay. All three detectors are taken to have light.

    Examples
    --------
    >>> import numpy as np, facets
    >>> known = facets.Calibration(("psd_a.height",), ((1e-6,),))  # 1 um, as a standard uncertainty
    >>> sensor = facets.Sensor(calibration=known)
    >>> sizes = [facets.mean_uncertainty(sensor, np.zeros(8), n, beam="known") for n in (1, 10_000)]
    >>> [f"{1e3 * size[2]:.2f} um of z" for size in sizes]
    ['1.54 um of z', '0.33 um of z']
    """
    if samples < 1:
        raise InputError(f"samples is {samples}; allowed: 1 or more")
    rows, shape = as_rows(states, 8, "states")
    plan = make_plan(sensor, Knowledge(beam=beam, power=power), shape=shape)
    out = np.empty((len(rows), 8))
    for part in slices_of(len(rows)):
        propagation = propagate_in_light(sensor, rows[part], plan)
        whole = covariance_of_mean(propagation, samples)
        if sensor.calibration is not None:
            whole += carry_over(sensor.calibration, propagation.slopes)
        out[part] = root_of_diagonal(whole)
    return frame_like(states, out.reshape(*shape, 8))


@check_arguments
def difference_uncertainty(
    sensor: Sensor,
    first: ArrayLike,
    second: ArrayLike,
    samples: int = 1,
    *,
    beam: BeamKnowledge = "free",
    power: PowerKnowledge = "known",
) -> Any:
    """Compute the standard uncertainty of the step from one pose to another.

    Parameters
    ----------
    sensor
        The sensor; with `Sensor.calibration` the calibration's part is in the result.
    first, second
        States, (..., 8) each; mm and rad, world frame: where the step began and where it ended.
    samples
        Number of samples whose mean each of the two poses is, 1 or more; see `mean_uncertainty`.
    beam, power
        What was known of them, as for `facets.solve`; of a `Prior` its sigma alone counts. A prior
        is taken to have independent errors at the two poses: for a beam that stood still meanwhile,
        say "known".

    Returns
    -------
    ndarray or DataFrame
        (..., 8), mm and rad: one standard deviation of `second` less `first`. NaN where a state is
        not finite or a detector has no reading. Where `second` is a data frame, the columns
        u_tx_mm, ..., u_yaw_mrad, ... with its index.

    Raises
    ------
    InputError
        If an argument has a wrong shape or value.

    Notes
    -----
    The parameters of the sensor are off by the same at both poses. What they do to the difference
    is the difference of what they do to the poses, which is small for a small step: the two poses'
    stated uncertainties say nothing of it. All three detectors are taken to have light.

    Examples
    --------
    >>> import numpy as np, facets
    >>> known = facets.Calibration(("psd_a.height",), ((1e-6,),))  # 1 um, as a standard uncertainty
    >>> sensor, start, end = facets.Sensor(calibration=known), np.zeros(8), np.zeros(8)
    >>> end[2] = 0.1
    >>> step = facets.difference_uncertainty(sensor, start, end, 10_000, beam="known")
    >>> f"{1e3 * step[2]:.3f} um of z"
    '0.021 um of z'
    """
    if samples < 1:
        raise InputError(f"samples is {samples}; allowed: 1 or more")
    try:
        both = np.broadcast_arrays(as_vectors(first, 8, "first"), as_vectors(second, 8, "second"))
    except ValueError as error:
        raise InputError(f"first and second do not fit each other: {error}") from None
    (before, shape), (after, _) = (as_rows(states, 8, "states") for states in both)
    plan = make_plan(sensor, Knowledge(beam=beam, power=power), shape=shape)
    sizes = step_uncertainties(sensor, (before, after), plan, samples)
    return frame_like(second, sizes.reshape(*shape, 8))


def step_uncertainties(
    sensor: Sensor, states: tuple[Floats, Floats], plan: Plan, samples: int
) -> Floats:
    """`difference_uncertainty` of states (n, 8) and others: (n, 8)."""
    out = np.empty((len(states[0]), 8))
    for part in slices_of(len(out)):
        some = states[0][part], states[1][part]
        first, second = (propagate_in_light(sensor, ends, plan) for ends in some)
        whole = covariance_of_mean(first, samples) + covariance_of_mean(second, samples)
        if sensor.calibration is not None:
            assert first.slopes is not None
            shares = common_shares(sensor.calibration, (first, second), some)
            slopes = -first.slopes, second.slopes
            whole += covariance_of_sum(sensor.calibration, slopes, shares)
        out[part] = root_of_diagonal(whole)
    return out


def propagate_in_light(
    sensor: Sensor, states: Floats, plan: Plan, used: Booleans | None = None
) -> Propagation:
    """`propagate` of states (n, 8) with light on the detectors that were used (n, 3), or on all;
    NaN where one of these has no reading."""
    if used is None:
        used = np.ones((len(states), 3), dtype=bool)
    propagation = propagate(sensor, sensor.calibration, states, used, plan)
    is_dark = (np.isnan(propagation.readings) & np.repeat(used, 3, axis=1)).any(axis=1)
    propagation.noise[is_dark], propagation.statistical[is_dark] = np.nan, np.nan
    return propagation


def covariance_of_mean(propagation: Propagation, samples: int) -> Floats:
    """The covariance (n, 8, 8) of a mean by noise and priors: its noise is smaller, the priors
    stay."""
    whole: Floats = propagation.noise / samples + (propagation.statistical - propagation.noise)
    return whole


def covariance_of_sum(
    known: Calibration, slopes: tuple[Floats, Floats | None], shares: Floats
) -> Floats:
    """The calibration's part (n, m, m) of the covariance of the sum of two quantities.

    slopes: their derivatives (n, m, p) by the parameters.  shares: (n, p) of the parameters'
    variances that they have in common.
    """
    first, second = slopes
    assert second is not None
    common, separate = np.sqrt(shares)[:, None, :], np.sqrt(1 - shares)[:, None, :]
    whole = carry_over(known, (second + first) * common)
    for part in (first, second):
        whole += carry_over(known, part * separate)
    return whole


def common_shares(
    known: Calibration, ends: tuple[Propagation, Propagation], states: tuple[Floats, Floats]
) -> Floats:
    """The share of each variance of `known` that two states have in common: (n, p)."""
    shift = (ends[1].readings - ends[0].readings).reshape(-1, 3, 3)[:, :, :2] / SPOT_LENGTH_MM
    apex = [state[:, :2] - state[:, 6:] for state in states]
    beside = (apex[1] - apex[0]) / APEX_LENGTH_MM
    squares = (shift**2).sum(axis=2) + (beside**2).sum(axis=1)[:, None]
    near = np.repeat(np.exp(-squares / 2), 3, axis=1)
    shares = np.ones((len(near), len(known.names)))
    for n, name in enumerate(known.names):
        if name in MISFIT:
            shares[:, n] = 0.0
        elif name in MODEL_ERROR:
            shares[:, n] = near[:, MODEL_ERROR.index(name)]
    return shares


def lasting_covariance(sensor: Sensor, propagation: Propagation, states: Floats) -> Floats:
    """The covariance (n, 8, n, 8) of what states (n, 8) err by in every sample alike.

    It holds the calibration's part, with what two states have in common as in a difference, and
    that of the priors, which err by the same at all states: the beam must have stood still. What
    two visits of the same state err by is the same.
    """
    count = len(states)
    whole: Floats = np.einsum("aip,bjp->aibj", propagation.priors, propagation.priors)
    known = sensor.calibration
    if known is None:
        return whole
    assert propagation.slopes is not None
    for n in range(count):
        single = propagation._replace(readings=propagation.readings[n : n + 1])
        common = np.sqrt(common_shares(known, (single, propagation), (states[n : n + 1], states)))
        common[n] = 1.0
        first = (propagation.slopes[n] * common[:, None, :]) @ np.array(known.covariance)
        whole[n] += np.einsum("bip,bjp->ibj", first, propagation.slopes * common[:, None, :])
    return whole
