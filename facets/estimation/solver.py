"""From readings to the mirror's pose: weighted least squares on all that is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import as_floats, checked
from ..core.errors import InputError
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import least_light, other_light, power_floor, standard_deviations
from ..model import evaluators, rare
from ..model.arrays import as_rows, as_vectors, half_sizes, packed, spot_size
from ..model.kinds import block_kind, lit_kind
from ..model.threads import part_of, share
from . import problem
from .chance import Chance, count_checks, widening_of
from .doubts import is_doubtful, take_back
from .solution import Solution, Status, solution


@checked
@dataclass(frozen=True)
class Prior:
    """What is known before the reading: a Gaussian of the given mean and standard deviation.

    For the beam, mean (..., 2) and sigma (a number or one each) of bx, by in mm; for the power,
    mean and sigma in mW. sigma 0: known exactly; infinite: not known at all.
    """

    mean: ArrayLike
    sigma: ArrayLike

    def __post_init__(self) -> None:
        if not (as_floats(self.sigma, "a prior's sigma") >= 0).all():
            raise InputError(f"a prior's sigma is {self.sigma!r}; allowed: 0 or more")
        if not np.isfinite(as_floats(self.mean, "a prior's mean")).all():
            raise InputError(f"a prior's mean is {self.mean!r}; allowed: finite numbers")


class Plan(NamedTuple):
    """What is asked for and what is known, as `problem.Problem` and `Limits` hold it.

    means: (1 or n, 3) of bx, by and the power.  weights: (3,).  free: numbers of the unknowns.
    """

    means: Floats
    weights: Floats
    free: NDArray[np.int64]
    limits: problem.Limits


def prior_of_beam(beam: object) -> Prior:
    if isinstance(beam, Prior):
        return beam
    sigma = {"free": np.inf, "known": 0.0}.get(beam) if isinstance(beam, str) else None
    if sigma is None:
        raise InputError(f'beam is {beam!r}; allowed: "free", "known" or a facets.Prior')
    return Prior((0.0, 0.0), sigma)


def prior_of_power(power: object, sensor: Sensor) -> Prior:
    if isinstance(power, Prior):
        return power
    sigma = {"known": 0.0, "unknown": np.inf}.get(power) if isinstance(power, str) else None
    if sigma is None:
        raise InputError(f'power is {power!r}; allowed: "known", "unknown" or a facets.Prior')
    return Prior(sensor.beam.power, sigma)


def means_of(place: Prior, light: Prior, shape: tuple[int, ...]) -> Floats:
    """What is known of bx, by and the power: (1, 3), or (n, 3) where it differs by reading."""
    where, amount = as_floats(place.mean, "mean"), as_floats(light.mean, "mean")
    shape = shape if where.shape[:-1] or amount.shape else ()
    try:
        means = np.empty((*shape, 3))
        means[..., :2], means[..., 2] = where, amount
    except ValueError as error:
        raise InputError(f"a prior does not fit readings of shape {shape}: {error}") from None
    return means.reshape(-1, 3)


def limits_of(sensor: Sensor, eight: bool) -> problem.Limits:
    """By what a sensor's readings are screened, made once a sensor: a live loop asks again."""
    kept: dict[bool, problem.Limits] = sensor.__dict__.setdefault("_limits", {})
    if eight not in kept:
        kept[eight] = make_limits(sensor, eight)
    return kept[eight]


def make_limits(sensor: Sensor, eight: bool) -> problem.Limits:
    noise, floor = sensor.noise, power_floor(sensor)
    distance = max(float(np.hypot(psd.radius, psd.height)) for psd in sensor.psds)
    return problem.Limits(
        noise=np.array([noise.position, noise.at_power, floor]),
        light=np.stack([least_light(sensor), other_light(sensor) + problem.DARK * floor]),
        half_sizes=half_sizes(sensor) - lost_at_edges(sensor),
        eight=eight,
        rounding=problem.ROUNDING * np.array([distance, sensor.beam.power]),
    )


def lost_at_edges(sensor: Sensor) -> float:
    """How near to an edge a spot's middle tells no place, mm: where the edge cuts the spot.

    The middle of a spot that is cut hardly moves while the spot goes on.
    """
    return spot_size(sensor) / 2 if sensor.apertures.detectors else 0.0


def plan(
    sensor: Sensor, beam: str | Prior, power: str | Prior, method: str, shape: tuple[int, ...]
) -> Plan:
    paper = method == "paper"
    if paper and not (beam == "free" and power == "known"):
        raise InputError('method="paper" has the beam "free" and the power "known"')
    place, light = prior_of_beam(beam), prior_of_power(power, sensor)
    sigmas = np.empty(3)
    try:
        sigmas[:2], sigmas[2] = as_floats(place.sigma, "sigma"), as_floats(light.sigma, "sigma")
    except ValueError:
        raise InputError(
            "a prior has too many sigmas; allowed: one number, or two for the beam's place"
        ) from None
    free = np.concatenate([np.arange(6), 6 + np.flatnonzero(sigmas > 0)])
    with np.errstate(divide="ignore"):
        weights = np.where(sigmas > 0, 1 / sigmas, 0.0)
    return Plan(means_of(place, light, shape), weights, free, limits_of(sensor, paper))


def chance_of(sensor: Sensor, todo: Plan) -> Chance:
    """What checks the poses that a plan gives."""
    none = count_checks(0, todo.free, todo.weights) - todo.limits.eight
    return Chance(none, widening_of(sensor))


#: So many plans are kept a sensor.
PLANS = 16


def plan_kept(
    sensor: Sensor, beam: str | Prior, power: str | Prior, method: str, shape: tuple[int, ...]
) -> Plan:
    """`plan`, made once a sensor where it is the same for any readings: a live loop asks again."""
    if not (is_for_any(beam, 2) and is_for_any(power, 1)):
        return plan(sensor, beam, power, method, shape)
    asked = beam, power, method
    kept: dict[tuple[str | Prior, str | Prior, str], Plan]
    kept = sensor.__dict__.setdefault("_plans", {})
    known = kept.get(asked)
    if known is None:
        if len(kept) >= PLANS:
            kept.clear()
        known = kept[asked] = plan(sensor, *asked, ())
    return known


def is_for_any(known: object, count: int) -> bool:
    """Whether what is known is a word, or a prior of plain numbers, `count` means in a tuple."""
    if not isinstance(known, Prior):
        return isinstance(known, str)
    means = known.mean if isinstance(known.mean, tuple) and count > 1 else (known.mean,)
    plain = all(isinstance(number, float) for number in (*means, known.sigma))
    return plain and len(means) == count


def starting(start: str | ArrayLike, todo: Plan, values: Floats, shape: tuple[int, ...]) -> Floats:
    """Where the estimates start: (1 or n, 9), with the means of what is known.

    An unknown power starts from the light that is seen.
    """
    unknown_power = todo.weights[2] == 0 and todo.free[-1] == 8
    if not isinstance(start, str):
        states = as_vectors(start, 8, "start")
        if states.shape != (*shape, 8):
            try:
                states = np.broadcast_to(states, (*shape, 8))
            except ValueError as error:
                raise InputError(f"start does not fit the readings: {error}") from None
        starts = np.empty((len(values), 9))
        starts[:, :8] = states.reshape(-1, 8)
        starts[:, 8] = todo.means[:, 2]
        if len(todo.free) < 8 or todo.free[7] != 7 or todo.free[6] != 6:
            starts[:, 6:8] = todo.means[:, :2]
    elif start in ("zero", "previous"):
        starts = np.zeros((len(values) if unknown_power else len(todo.means), 9))
        starts[:, 6:] = todo.means
        starts[:, :2] = todo.means[:, :2]  # there is light to read only near the beam
    else:
        raise InputError(f'start is {start!r}; allowed: "zero", "previous" or states (..., 8)')
    if unknown_power:
        with np.errstate(over="ignore", invalid="ignore"):  # a spoilt reading can be anything
            seen = np.nansum(values[:, 2::3], axis=1)
        starts[:, 8] = np.where(np.isfinite(seen) & (seen > 0), seen, starts[:, 8])
    return starts


def add_calibration(sensor: Sensor, todo: Plan, found: problem.Results) -> None:
    """Adds to the covariances what the parameters' own, `Sensor.calibration`, is worth."""
    if sensor.calibration is not None and len(found.covariances) > 0:
        from .calibration_uncertainty import covariances as inherited

        found.covariances[:] += inherited(
            sensor, sensor.calibration, found.states[:, :8], found.used, todo.free, todo.weights
        )


def estimate(
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.Limits,
    asked: problem.Problem,
    found: problem.Results,
) -> None:
    """Fills `found`: by blocks where these know what is asked, and one by one what they leave.

    Under the light of a bench what stalls is estimated again by exact derivatives."""
    near = evaluators.nearly_linearised(sensor)
    code = block_code(sensor, asked)
    if code is None:
        one_by_one(near, sensor, readings, limits, asked, found)
    else:
        from . import blocks

        left = blocks.estimate(code, packed(sensor), readings, limits, asked, found)
        if len(left) and sensor.light.on:
            left = blocks.estimate_some(code, left, packed(sensor), readings, limits, asked, found)
        if len(left):
            estimate_some(near, left, sensor, readings, limits, asked, found)
    if sensor.light.on:
        estimate_stalled_again(sensor, readings, limits, asked, found)


def block_code(
    sensor: Sensor, asked: problem.Problem, exact: bool = False, width: int | None = None
) -> Callable[[int], None] | None:
    """What estimates blocks of readings, compiled now if need be; None where blocks do not know
    what is asked. exact: see `blocks.Form`.  width: see `blocks.kernel`."""
    kind = block_kind(sensor)
    if kind is None:
        return None
    from . import blocks

    form = blocks.Form(tuple(asked.free.tolist()), kind, exact)
    return blocks.kernel(form, width) if blocks.fits(asked) else None


def one_by_one(
    model: str,
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.Limits,
    asked: problem.Problem,
    found: problem.Results,
) -> None:
    """model: of `evaluators`."""
    from . import as_text

    left = as_text.estimate(model, sensor, readings, limits, asked, found)
    if len(left) == 0:
        return
    if len(left) < len(readings.values):
        estimate_some(model, left, sensor, readings, limits, asked, found)
        return
    from .kernels import kernel

    given = problem.Model(evaluators.address(model), packed(sensor))
    task = problem.Task(given, readings, limits, asked, found, problem.workspace())
    kernel()(task.address)


def prepare(sensor: Sensor, beam: str | Prior, power: str | Prior) -> None:
    """Compiles or loads now what a reading may need that leaves its block, or stalls there, for a
    loop that cannot wait. beam, power: as for `solve`."""
    from .kernels import kernel

    kernel()
    rare.prepare()
    for model in (evaluators.nearly_linearised(sensor), evaluators.linearised(sensor)):
        evaluators.model(model)
    if sensor.light.on and not sensor.apertures.cut:
        from . import blocks

        free = plan(sensor, beam, power, "least-squares", ()).free
        blocks.kernel(blocks.Form(tuple(free.tolist()), lit_kind(sensor), exact=True))


def estimate_some(
    model: str,
    which: NDArray[np.intp],
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.Limits,
    asked: problem.Problem,
    found: problem.Results,
) -> None:
    """Estimates some readings one by one, anew, and puts what is found in its places."""
    again = problem.empty_results(len(which), len(found.covariances) > 0)
    some, questions = problem.some_rows(which, readings, asked)
    one_by_one(model, sensor, some, limits, questions._replace(previous=False), again)
    problem.put_rows(found, which, again)


def estimate_stalled_again(
    sensor: Sensor,
    readings: problem.Readings,
    limits: problem.Limits,
    asked: problem.Problem,
    found: problem.Results,
) -> None:
    """Under the light of a bench: what stalled, by the derivatives that leave nothing out."""
    stalled, asked = np.flatnonzero(found.status == Status.STALLED), asked._replace(previous=False)
    code = block_code(sensor, asked, exact=True) if len(stalled) else None
    if code is not None:
        from . import blocks

        numbers = packed(sensor)
        stalled = blocks.estimate_some(code, stalled, numbers, readings, limits, asked, found)
    if len(stalled):
        model = evaluators.linearised(sensor)
        estimate_some(model, stalled, sensor, readings, limits, asked, found)


@checked
def solve(
    sensor: Sensor,
    readings: ArrayLike,
    *,
    beam: Literal["free", "known"] | Prior = "free",
    power: Literal["known", "unknown"] | Prior = "known",
    start: Literal["zero", "previous"] | ArrayLike = "zero",
    method: Literal["least-squares", "paper"] = "least-squares",
    max_steps: int = 50,
    covariance: bool = True,
    accept_unchecked: bool = False,
    threads: int = 1,
) -> Solution:
    """The mirror's pose and the beam's place from the detectors' readings.

    Weighted least squares on all nine readings, weights from the sensor's noise, by Gauss-Newton
    steps that are damped where they do not help.

    readings: (..., 9) as `facets.readings` gives them. A detector with a NaN, without light or with
    a spot past its edge is left out; what two detectors give is a pose only on request, see below.
    beam: its place is "free", "known" to be (0, 0), or has a `Prior` in mm.
    power: "known" as the sensor's, "unknown", or a `Prior` in mW.
    start: "zero" (with the apex where the beam is thought to be), "previous" (the last converged
    sample before), or states (..., 8).
    method: "paper" is Newton's method on eight readings, without the power of C (section 2.3 of the
    paper): no weights, no damping, the beam free and its power known. Nothing checks its poses.
    accept_unchecked: also give poses that nothing checks. Two detectors with the beam and the power
    known, or with priors, have as many numbers as there are unknowns, and so have three detectors
    with the beam free and the power unknown. Six numbers give some pose for six unknowns also where
    one of them is spoilt, with no residual to tell, and a second pose, far away, may give the same
    six. Without this, such a reading has the status UNCHECKED and no pose.
    threads: that share the readings; 0 for all cores. With start="previous" each begins at zero.

    Bad arguments raise `InputError`; a reading that cannot be solved gets a status and NaN. A pose
    whose residual noise would hardly leave is there, and not `ok`; see `Solution`.

    >>> import numpy as np, facets
    >>> sensor = facets.Sensor()
    >>> reading = facets.readings(sensor, [0.01, 0, 0.5, 0, 0, 0.001, 0, 0])
    >>> solution = facets.solve(sensor, reading, beam="known")
    >>> bool(solution.ok), f"yaw {1e3 * solution.state[5]:.3f} mrad"
    (True, 'yaw 1.000 mrad')
    >>> facets.Status(int(facets.solve(sensor, np.zeros(9)).status)).label
    'no light'
    """
    given = as_vectors(readings, 9, "readings")
    if max_steps < 1:
        raise InputError(f"max_steps is {max_steps}; allowed: 1 or more")
    if given.ndim == 1 and isinstance(beam, str) and isinstance(power, str) and threads >= 0:
        from .prepared import kept_solver

        solver = kept_solver(sensor, beam, power, method, max_steps, covariance, accept_unchecked)
        return solver.solve_from(given, solver.starting(start, given))
    values, shape = as_rows(given, 9, "readings")
    todo = plan_kept(sensor, beam, power, method, shape)
    asked = problem.Problem(
        means=todo.means,
        weight=todo.weights,
        free=todo.free,
        starts=starting(start, todo, values, shape),
        previous=isinstance(start, str) and start == "previous",
        max_steps=max_steps,
        damped=method != "paper",
        accept_unchecked=accept_unchecked or method == "paper",
    )
    rows = problem.Readings(values, sigmas_of(sensor, values))
    found = solve_rows(sensor, rows, todo, asked, covariance, threads)
    return solution(found, shape, chance_of(sensor, todo))


def local_solution(sensor: Sensor, reading: Floats, start: Floats) -> tuple[Floats, float]:
    """The state (8,) to which a reading (9,) leads from a start (8,), the beam free, and the
    residual there; NaN where it leads to none. Another state may give the same reading."""
    todo, values = plan_kept(sensor, "free", "known", "least-squares", ()), reading[None].copy()
    asked = problem.Problem(
        todo.means, todo.weights, todo.free, starting(start, todo, values, ()),
        previous=False, max_steps=50, damped=True, accept_unchecked=False,
    )  # fmt: skip
    found = problem.empty_results(1, False)
    estimate(sensor, problem.Readings(values, sigmas_of(sensor, values)), todo.limits, asked, found)
    return found.states[0, :8], float(found.residuals[0])


def sigmas_of(sensor: Sensor, values: Floats) -> Floats:
    """The readings' standard deviations as `problem.Readings` has them."""
    return np.empty((0, 9)) if sensor.electronics is None else standard_deviations(sensor, values)


def solve_rows(
    sensor: Sensor,
    given: problem.Readings,
    todo: Plan,
    asked: problem.Problem,
    covariance: bool,
    threads: int = 1,
) -> problem.Results:
    """`solve` of readings that are checked."""
    n = len(given.values)
    found = problem.empty_results(n, covariance)
    block_code(sensor, asked)  # compiled once, before threads ask for it

    def run(part: slice) -> None:
        some, questions = problem.some_rows(part, given, asked)
        results = problem.Results(*(part_of(array, part, n) for array in found))
        estimate(sensor, some, todo.limits, questions, results)

    share(run, n, threads)
    if is_doubtful(sensor, todo.free):

        def again(rows: NDArray[np.intp], starts: Floats) -> problem.Results:
            some, questions = problem.some_rows(rows, given, asked)
            results = problem.empty_results(len(rows), False)
            questions = questions._replace(starts=starts, previous=False)
            estimate(sensor, some, todo.limits, questions, results)
            return results

        take_back(sensor, todo.free, chance_of(sensor, todo), found, again)
    if covariance:
        add_calibration(sensor, todo, found)
    return found
