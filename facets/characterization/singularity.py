"""Check that the Jacobian is regular over a box of states, by samples as in Fig. 4 and by search.

The determinant of Eq. (11), of all readings but one, has units in which no size is small or large.
A meaningful measure is the smallest singular value of the Jacobian with its columns in um and urad
and its rows in standard deviations of the readings. It is the readings' total response, in standard
deviations, to one unit along the direction of the weakest response.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.sensor import Sensor
from ..core.units import Floats, Integers
from ..model.arrays import derivatives, readings
from .ranges import LEFT_OUT, saturation_clearances, scale_to_noise, scaled_jacobian
from .sobol import Sobol
from .state_box import AXES, StateBox, apex_offset

CHUNK = 100_000
#: Number of different points of a Sobol sequence of 30 bits.
MAX_STATES = 2**30
#: Names of a state's measures.
MEASURES = ("determinant", "smallest singular value", "condition number")


def measures(
    sensor: Sensor,
    states: Floats,
    spectra: bool = True,
) -> Floats:
    """Compute `MEASURES` (n, 3) at states (n, 8); NaN if a detector has no reading.

    The determinant is that of Eq. (11), without the power of C; mm, mW and rad. The other two
    measures use all nine readings, um and urad; NaN without `spectra`.
    """
    out = np.full((len(states), 3), np.nan)
    for first in range(0, len(states), JACOBIANS_AT_ONCE):
        some = slice(first, first + JACOBIANS_AT_ONCE)
        fill_measures(sensor, states[some], spectra, out[some])
    return out


#: Number of states whose Jacobians are in memory at a time.
JACOBIANS_AT_ONCE = 2000


def fill_measures(sensor: Sensor, states: Floats, spectra: bool, out: Floats) -> None:
    """Fill out (n, 3) with `measures`."""
    matrices = derivatives(sensor, states)
    lit = ~np.isnan(matrices).any(axis=(1, 2))
    rest = matrices[lit]
    out[lit, 0] = np.linalg.det(np.delete(rest, LEFT_OUT, axis=1))
    if spectra:
        out[lit, 1:] = extremes(scale_to_noise(sensor, states[lit], rest))


#: Above this squared condition number the eigenvalues of J'J have lost half their digits.
MAX_SQUARED_CONDITION = 1e8


def extremes(matrices: Floats) -> Floats:
    """The smallest singular value and the condition number of matrices (n, 9, 8): (n, 2)."""
    values = np.linalg.eigvalsh(matrices.transpose(0, 2, 1) @ matrices)[:, [0, -1]]
    near = ~(values[:, 0] * MAX_SQUARED_CONDITION > values[:, 1])
    values[near] = np.linalg.svd(matrices[near], compute_uv=False)[:, [-1, 0]] ** 2
    with np.errstate(divide="ignore"):
        return np.sqrt(np.stack([values[:, 0], values[:, 1] / values[:, 0]], axis=1))  # type: ignore[no-any-return]


class Worst(NamedTuple):
    """A state (8,) and its measures (3,)."""

    state: Floats
    values: Floats


@dataclass
class Survey:
    """The results of a survey of many states.

    counts: (OFFSETS, LEVELS) of states by apex offset and determinant; second: by smallest singular
    value.  edges: of offsets (mm), determinants, singular values.  low, high: (3,) of each measure.
    signs: numbers of negative, zero and positive determinants.  weakest: the state with the least
    smallest singular value.  unlit: number of states in which a detector has no reading.
    saturated: number of states at which a detector is saturated, so that the sensor has no reading;
    their measures are included all the same.
    """

    edges: tuple[Floats, Floats, Floats]
    counts: Floats
    second: Floats
    low: Floats
    high: Floats
    signs: Integers
    weakest: Worst
    states: int = 0
    unlit: int = 0
    saturated: int = 0

    @property
    def one_sign(self) -> bool:
        """Whether every state has light on all detectors, and all determinants have one sign."""
        return self.unlit == 0 and self.has_one_sign_in_light

    @property
    def has_one_sign_in_light(self) -> bool:
        """Whether all states with light on all detectors have determinants of one sign."""
        return self.states - self.unlit in (self.signs[0], self.signs[2])


OFFSETS, LEVELS = 120, 160


def samples(
    domain: StateBox, count: int, sampling: Literal["sobol", "uniform"], seed: int
) -> Iterator[Floats]:
    """States of the box (n, 8), mm and rad, chunk by chunk. Raises `InputError` for an impossible
    count or sampling."""
    if not 1 <= count <= MAX_STATES:
        raise InputError(f"states are {count}; allowed: 1 to {MAX_STATES:,}")
    if sampling not in ("sobol", "uniform"):
        raise InputError(f'sampling is {sampling!r}; allowed: "sobol", "uniform"')
    rng = np.random.default_rng(seed)
    sobol = Sobol(8, rng) if sampling == "sobol" else None
    for first in range(0, count, CHUNK):
        rows = min(CHUNK, count - first)
        yield domain.states(rng.random((rows, 8)) if sobol is None else sobol.draw(rows))


def survey(
    sensor: Sensor,
    chunks: Iterator[Floats],
) -> Survey:
    """Measure all states, chunk by chunk of states (n, 8). Raises `InputError` if none of them has
    light on all detectors."""
    result: Survey | None = None
    for states in chunks:
        values = measures(sensor, states)
        if result is None:
            result = empty_survey(apex_offset(states), values)
        count_states(result, states, values)
        if sensor.electronics is not None:
            margins = saturation_clearances(sensor, readings(sensor, states))
            result.saturated += int((margins < 0).sum())
    assert result is not None
    if result.unlit == result.states:
        raise InputError(
            f"none of the {result.states:,} states drawn gives every detector a reading: the box "
            "lies where the beam misses the mirror or the spots their detectors; give a smaller one"
        )
    return result


def empty_survey(offset: Floats, values: Floats) -> Survey:
    """A survey without counts whose classes cover the first chunk and a margin. offset: (n,), mm.
    values: (n, 3), see `measures`."""
    with np.errstate(invalid="ignore"):
        top = float(offset.max(initial=0.0)) * 1.02 or 1.0
        ends = [extent_of(values[:, 0]), extent_of(values[:, 1])]
    edges = (np.linspace(0, top, OFFSETS + 1), *(np.linspace(*end, LEVELS + 1) for end in ends))
    return Survey(
        edges=(edges[0], edges[1], edges[2]),
        counts=np.zeros((OFFSETS, LEVELS)),
        second=np.zeros((OFFSETS, LEVELS)),
        low=np.full(3, np.inf),
        high=np.full(3, -np.inf),
        signs=np.zeros(3, np.int64),
        weakest=Worst(np.full(8, np.nan), np.full(3, np.nan)),
    )


def extent_of(values: Floats) -> tuple[float, float]:
    """An interval from zero to beyond the largest values, or on both sides of zero. It is 0 to 1 if
    no value is finite."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return 0.0, 1.0
    low, high = min(0.0, 1.15 * finite.min()), max(0.0, 1.15 * finite.max())
    return low, high if high > low else low + 1


def count_states(result: Survey, states: Floats, values: Floats) -> None:
    """Add states (n, 8) with their measures (n, 3) to a survey."""
    lit = np.isfinite(values[:, 0])
    result.states += len(states)
    result.unlit += int((~lit).sum())
    if not lit.any():
        return
    states, values = states[lit], values[lit]
    offset = np.minimum(apex_offset(states), result.edges[0][-1])
    for counts, edges, column in ((result.counts, 1, 0), (result.second, 2, 1)):
        ends = result.edges[edges]
        held = np.clip(values[:, column], ends[0], ends[-1])
        counts += np.histogram2d(offset, held, bins=(result.edges[0], ends))[0]
    result.low = np.fmin(result.low, values.min(axis=0))
    result.high = np.fmax(result.high, values.max(axis=0))
    sign = np.sign(values[:, 0])
    result.signs += [int((sign == s).sum()) for s in (-1, 0, 1)]
    n = int(values[:, 1].argmin())
    if not values[n, 1] >= result.weakest.values[1]:
        result.weakest = Worst(states[n].copy(), values[n].copy())


def search_weakest(sensor: Sensor, domain: StateBox, seed: int = 1) -> Worst:
    """The state of the box with the least smallest singular value, by differential evolution and
    descent."""
    from scipy.optimize import differential_evolution

    wide = np.flatnonzero(domain.high > domain.low)

    def states_at(shares: Floats) -> Floats:
        """States (n, 8) at shares (w, n) of the sides that are not 0."""
        points = np.full((shares.shape[1], 8), 0.5)
        points[:, wide] = shares.T
        return domain.states(points)

    def least(shares: Floats) -> Floats:
        """The least singular value at parts of the box's width; 1e9 where it has none."""
        values = measures(sensor, states_at(shares.reshape(len(wide), -1)))[:, 1]
        size: Floats = np.nan_to_num(values, nan=1e9)
        return size if shares.ndim == 2 else size[0]

    shares = np.empty((0, 1))
    if len(wide):
        shares = differential_evolution(
            least, [(0, 1)] * len(wide), rng=np.random.default_rng(seed), vectorized=True,
            updating="deferred", maxiter=400, tol=1e-8,
        ).x[:, None]  # fmt: skip
    state = states_at(shares)
    return Worst(state[0], measures(sensor, state)[0])


def weakest_direction(sensor: Sensor, state: Floats) -> Floats:
    """The direction (8,) of the weakest response of the readings, µm and µrad, length 1.

    NaN if the readings have no derivatives.
    """
    matrix = scaled_jacobian(sensor, state[None])[0]
    if not np.isfinite(matrix).all():
        return np.full(8, np.nan)
    vector: Floats = np.linalg.svd(matrix)[2][-1]
    return vector * (np.sign(vector[np.abs(vector).argmax()]) or 1.0)


#: Smaller parts of a direction are not named.
MIN_NAMED_PART = 0.25


def direction_in_words(direction: Floats) -> str:
    """Name the parts of the state that move along a direction (8,), of unit length."""
    if not np.isfinite(direction).all():
        return "a state without light, in every direction"
    large = np.abs(direction) > MIN_NAMED_PART
    words = []
    for letter, t, b in (("x", 0, 6), ("y", 1, 7)):
        if large[t] and large[b]:
            together = direction[t] * direction[b] > 0
            words.append(f"mirror and beam {'together' if together else 'apart'} along {letter}")
        elif large[t]:
            words.append(f"mirror along {letter}")
        elif large[b]:
            words.append(f"beam along {letter}")
    words += [f"mirror along {AXES[2][1]}"] if large[2] else []
    words += [AXES[i] for i in (3, 4, 5) if large[i]]
    return ", ".join(words)
