"""Faults of real benches. Each changes values at some stages of a measurement (`simulated_bench`),
most often by a direction times a waveform.

`disturbed_rigs` lists faults of given sizes, and `unseen_rigs` draws faults of random sizes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from facets.core.units import Floats
from facets.detectors.noise import standard_deviations

from .bench_rays import RayBench, RayFacet, facet_light, facet_of, sample_facet, spots
from .rigs import Rng
from .simulated_bench import Columns, MotionScene, Parts

#: Half size of a detector, mm, and the power on it at rest, mW.
HALF_MM, POWER_MW = 6.5, 0.1
#: Columns of the places in a reading, and of the angles in a pose.
PLACES, ANGLES = [0, 1, 3, 4, 6, 7], [3, 4, 5]

#: Function that computes the size (n,) of a fault over the rows.
Waveform = Callable[[MotionScene, Rng], Floats]
#: Function that selects rows.
Rows = Callable[[MotionScene, Rng], Any]


# ---- waveforms


def step(at: float) -> Waveform:
    """1 after a fraction of the motion, 0 before."""
    return lambda scene, rng: (scene.progress > at).astype(float)


def ramp(scene: MotionScene, rng: Rng) -> Floats:
    """A straight line from -0.5 to 0.5 over the motion."""
    return scene.progress - 0.5


def warmth(scene: MotionScene, rng: Rng) -> Floats:
    """The temperature of the air, K."""
    return scene.air


def late_warmth(tau: float) -> Waveform:
    """The temperature of a body that follows the air with a time constant, s."""

    def waveform(scene: MotionScene, rng: Rng) -> Floats:
        """The delayed temperature (n,), K, about its mean."""
        follow = 1 - np.exp(-(scene.time[1] - scene.time[0]) / tau)
        late = scene.air[0] + low_pass(scene.air - scene.air[0], follow, 1 - follow)
        return np.asarray(late - late.mean())

    return waveform


def white(scene: MotionScene, rng: Rng) -> Floats:
    """Independent normal numbers of variance 1."""
    return rng.standard_normal(scene.rows)


def wander(length: float) -> Waveform:
    """Random motion of r.m.s. 1 with a memory of some rows."""
    keep = np.exp(-1 / length)
    return lambda scene, rng: low_pass(white(scene, rng), np.sqrt(1 - keep**2), keep)


def walk(scene: MotionScene, rng: Rng) -> Floats:
    """Random walk (n,) of r.m.s. 1 about its mean."""
    way = np.cumsum(white(scene, rng))
    return np.asarray((way - way.mean()) / way.std())


def hum(per_row: float) -> Waveform:
    """A vibration with more cycles than the rows resolve."""
    return lambda scene, rng: np.sin(2 * np.pi * (per_row * np.arange(scene.rows) + rng.random()))


def hops(length: float) -> Waveform:
    """Random jumps between 0 and 1, some rows apart."""
    return lambda scene, rng: (np.cumsum(rng.random(scene.rows) < 1 / length) % 2).astype(float)


def glitches(fraction: float) -> Waveform:
    """Random numbers in a fraction of the rows, 0 in the others."""
    return lambda scene, rng: white(scene, rng) * (rng.random(scene.rows) < fraction)


def low_pass(values: Floats, gain: float, keep: float) -> Floats:
    """Output of a first-order filter along the rows: y[n] = gain x[n] + keep y[n - 1]."""
    return np.asarray(lfilter([gain], [1, -keep], values))


def previous(values: Floats) -> Floats:
    """The values shifted by one row; the first one is repeated."""
    return np.concatenate([values[:1], values[:-1]])


# ---- directions


def detector_vector(k: int, direction: Floats | list[float]) -> Floats:
    """A direction (9,) of readings, from that of one detector's place (2,) or reading (3,)."""
    out = np.zeros(9)
    out[3 * k : 3 * k + len(direction)] = direction
    return out


def place_vector(directions: Floats) -> Floats:
    """A direction (9,) of readings, from that of all places (6,)."""
    out = np.zeros(9)
    out[PLACES] = directions
    return out


def axis(number: int, size: float = 1.0) -> Floats:
    """A direction (6,) of poses along one axis."""
    return np.asarray(size * np.eye(6)[number])


# ---- changes at a stage


def add(stage: str, direction: Floats | list[float], waveform: Waveform) -> Parts:
    """Add a direction (m,) times a waveform."""
    return {stage: lambda values, scene, rng: values + np.outer(waveform(scene, rng), direction)}


def add_each(stage: str, directions: Floats | list[float], waveform: Waveform) -> Parts:
    """Add each component of a direction (m,) with a separate draw of the waveform, such as
    noise."""

    def hook(values: Floats, scene: MotionScene, rng: Rng) -> Floats:
        each = np.column_stack([size * waveform(scene, rng) for size in directions])
        return np.asarray(values + each)

    return {stage: hook}


def change_bench(**fields: Any) -> Parts:
    """Change properties of the rays' light, which are fields of `RayBench`."""
    return {"bench": lambda bench, scene, rng: bench._replace(**fields)}


def change_profile(factor: Callable[[Floats, Floats], Any]) -> Parts:
    """Multiply the irradiance by a factor, a function of x and y, in standard deviations of the
    beam."""
    return change_bench(profile=lambda places: factor(places[..., 0], places[..., 1]))


def add_mode(fraction: float) -> Callable[[Floats, Floats], Floats]:
    """Function of x and y (standard deviations of the beam) that returns the factor of the
    irradiance with a fraction of the light in the first ring mode."""
    return lambda x, y: 1 + fraction * ((1 - (x * x + y * y) / 2) ** 2 - 1)


def ghost_factor(fraction: float, a: float, b: float) -> Callable[[Floats, Floats], Floats]:
    """Function of x and y (standard deviations of the beam) that returns the factor of the
    irradiance with a second beam, whose fraction of the light and distance (a, b) are stated."""
    return lambda x, y: 1 - fraction + fraction * np.exp(a * x + b * y - (a * a + b * b) / 2)


def add_fringes(depth: float, waves: Floats, phase: float = 0.0) -> Any:
    """Function of x and y (standard deviations of the beam) that returns the factor of the
    irradiance with fringes of a relative depth; waves: wave numbers (2,), radians per standard
    deviation."""
    return lambda x, y: 1 + depth * np.cos(waves[0] * x + waves[1] * y + phase)


def dim(loss: float, waveform: Waveform) -> Parts:
    """Reduce the laser's power by a fraction `loss` times a waveform."""
    return {"power": lambda power, scene, rng: power * (1 - loss * waveform(scene, rng))}


def error_matrix(matrix: Floats) -> Parts:
    """A reference that adds a matrix (6, 6) times the pose (mm, rad) to it."""
    return {"reference": lambda said, scene, rng: said + scene.pose @ matrix.T}


def pose_error(number: int, error: Callable[[Floats], Floats]) -> Parts:
    """A reference that adds to one axis a function of the pose (n, 6)."""
    return add("reference", axis(number), lambda scene, rng: error(scene.pose))


def backlash(size: Floats) -> Parts:
    """The mirror lags by half of the backlash (6,), mm and rad, against each axis's last step."""
    return {"mirror": lambda pose, scene, rng: pose - size * np.sign(pose - previous(pose))}


def lag(fraction: float) -> Parts:
    """The mirror lags by a fraction of each step."""
    return {"mirror": lambda pose, scene, rng: pose - fraction * (pose - previous(pose))}


def delay(late: float, waveform: Waveform) -> Parts:
    """A reference that is sampled later than the readings, by `late` s times a waveform."""
    return {"reference": lambda said, scene, rng: said + scene.shift(late * waveform(scene, rng))}


def edit(
    stage: str, columns: Any, change: Callable[[Floats], Floats], rows: Rows | None = None
) -> Parts:
    """Change columns (n, m) of readings or poses in some rows, by default in all."""

    def hook(values: Floats, scene: MotionScene, rng: Rng) -> Floats:
        out, some = values.copy(), rows(scene, rng) if rows else np.ones(scene.rows, bool)
        out[np.ix_(some, columns)] = change(values[:, columns])[some]
        return out

    return {stage: hook}


def between(first: float, last: float) -> Rows:
    """Select the rows between two fractions of the motion."""
    return lambda scene, rng: (scene.progress >= first) & (scene.progress < last)


def random_rows(fraction: float) -> Rows:
    """Select a fraction of the rows at random."""
    return lambda scene, rng: rng.random(scene.rows) < fraction


def round_to(grid: float | Floats) -> Callable[[Floats], Floats]:
    """Make a function that rounds values to a grid."""
    return lambda values: grid * np.round(values / grid)


def smooth(rows: int) -> Callable[[Floats], Floats]:
    """Make a function that takes means of columns (n, m) over an odd number of rows."""

    def change(values: Floats) -> Floats:
        wide = np.pad(values, ((rows // 2,) * 2, (0, 0)), mode="reflect", reflect_type="odd")
        windows = np.lib.stride_tricks.sliding_window_view(wide, rows, axis=0)
        return np.asarray(windows.mean(axis=-1))

    return change


def reorder_angles(angles: Floats) -> Floats:
    """The angles (n, 3), rad, of a stage that turns about its axes in the other order."""
    return np.asarray(Rotation.from_euler("xyz", angles).as_euler("zyx")[:, ::-1])


def take_rows(order: Rows) -> Parts:
    """Keep the rows of the table that `order` returns, in that order."""

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        rows = order(scene, rng)
        return {name: column[rows] for name, column in columns.items()}

    return {"table": hook}


def add_column(name: str, waveform: Waveform) -> Parts:
    """Add a column to the table, such as the temperature, for the rows as they were measured."""
    return {"table": lambda columns, scene, rng: columns | {
        name: waveform(scene, rng)[columns["row"].astype(int)]}}  # fmt: skip


def add_thermometer(waveform: Waveform = warmth) -> Parts:
    """Add the column temperature_c with a waveform about 21.3 degrees."""
    return add_column("temperature_c", lambda scene, rng: np.round(21.3 + waveform(scene, rng), 3))


# ---- readings


def add_light(raw: Floats, power: Floats, place: Floats) -> Floats:
    """Add light of powers (n, 3) at places (n, 3, 2) to readings."""
    parts = raw.reshape(-1, 3, 3)
    total = parts[..., 2] + power
    moments = parts[..., :2] * parts[..., 2:] + place * power[..., None]
    return np.concatenate([moments / total[..., None], total[..., None]], axis=-1).reshape(-1, 9)


def shine(power: Floats | list[float], place: Floats, waveform: Waveform) -> Parts:
    """Other light of powers (3,) at places (3, 2) on the detectors."""
    return {"readings": lambda raw, scene, rng: add_light(
        raw, np.outer(waveform(scene, rng), power), place[None])}  # fmt: skip


def scatter_light(k: int, fraction: float, place: Floats) -> Parts:
    """A fraction of the next facet's light falls on a place (2,), mm, of the detector k."""

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        power = fraction * raw[:, 3 * ((k + 1) % 3) + 2]
        return add_light(raw, np.outer(power, np.eye(3)[k]), np.broadcast_to(place, (1, 3, 2)))

    return {"readings": hook}


def lose_light(k: int, patch: Callable[[RayFacet], tuple[Floats, Floats]]) -> Parts:
    """Remove the light that a patch of a facet reflects; patch: its points (m, 3) and areas
    (m,)."""

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        assert scene.states is not None
        facet = facet_of(scene.real.rig.sensor, scene.real.bench, scene.states, k)
        light = facet_light(facet, *patch(facet))
        power, place = np.zeros((scene.rows, 3)), np.zeros((scene.rows, 3, 2))
        power[:, k], place[:, k] = -light.power, light.place
        return add_light(raw, power, place)

    return {"readings": hook}


def dust(k: int, radius: float, loss: float, away: float, opening: float) -> Parts:
    """A disc that absorbs a fraction of the light, `away` mm from the tip of a facet.

    radius: of the disc, mm.  opening: direction of its centre, as a fraction of the facet's
    opening.
    """
    r, turn = np.meshgrid(np.sqrt((np.arange(8) + 0.5) / 8), np.arange(16) * np.pi / 8)
    flat = radius * np.column_stack([(r * np.cos(turn)).ravel(), (r * np.sin(turn)).ravel()])

    def patch(facet: RayFacet) -> tuple[Floats, Floats]:
        """Points (m, 3) of the dust on the facet, and the areas that they lose."""
        angle = np.arccos(facet.edges[0] @ facet.edges[1]) * opening
        middle = away * np.array([np.cos(angle), np.sin(angle)])
        points = (middle + flat) @ np.array([facet.edges[0], facet.inward[0]])
        return points, np.full(len(flat), loss * np.pi * radius**2 / len(flat))

    return lose_light(k, patch)


def tarnish(k: int, loss: float) -> Parts:
    """A facet's reflectance decreases by `loss` for each mm from its first edge."""

    def patch(facet: RayFacet) -> tuple[Floats, Floats]:
        """Points (m, 3) of the facet, and the areas that they lose."""
        points, area, distances = sample_facet(facet)
        return points, area * np.minimum(loss * distances[:, 0], 1)

    return lose_light(k, patch)


def turn_polarisation(turn: float) -> Parts:
    """The light's polarisation turns from the first row to the last."""

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        angle = (scene.real.bench.polarisation or 0.0) + turn
        bench = scene.real.bench._replace(polarisation=angle)
        return raw + scene.progress[:, None] * (
            exact_readings(scene, bench) - exact_readings(scene)
        )

    return {"readings": hook}


def exact_readings(
    scene: MotionScene, bench: RayBench | None = None, moved: Floats | float = 0.0
) -> Floats:
    """Exact readings (n, 9) of a scene, with other light or with states that are moved."""
    assert scene.states is not None
    return spots(scene.real.rig.sensor, bench or scene.real.bench, scene.states + moved)


def delay_detector(k: int, late: float) -> Parts:
    """A detector that is read later than the others, by `late` s."""

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        moved = np.pad(scene.shift(np.full(scene.rows, late)), ((0, 0), (0, 2)))
        change = exact_readings(scene, moved=moved) - exact_readings(scene)
        return np.asarray(raw + change * (np.arange(9) // 3 == k))

    return {"readings": hook}


def bend_places(k: int, error: Callable[[Floats], Floats]) -> Parts:
    """Add a function of a detector's places (n, 2) to them."""
    return edit("readings", [3 * k, 3 * k + 1], lambda place: place + error(place))


def remember(fraction: float, detectors: Floats | float = 1.0) -> Parts:
    """Readings that retain a fraction of the previous row; detectors: weights (9,)."""
    return {"readings": lambda raw, scene, rng: raw + fraction * detectors * (previous(raw) - raw)}


def change_currents(raw: Floats, change: Callable[[Floats], Floats]) -> Floats:
    """Change the electrodes' currents (n, 3, 2, 2), mW, of each detector, axis and end."""
    parts, out = raw.reshape(-1, 3, 3), np.empty((len(raw), 3, 3))
    ends = np.stack([1 + parts[..., :2] / HALF_MM, 1 - parts[..., :2] / HALF_MM], axis=-1)
    current = change(ends * parts[..., 2, None, None] / 2)
    total = current.sum(axis=-1)
    out[..., :2] = HALF_MM * (current[..., 0] - current[..., 1]) / total
    out[..., 2] = total.mean(axis=-1)
    return out.reshape(-1, 9)


def bend_currents(change: Callable[[Floats, Any], Floats], size: Floats | float) -> Parts:
    """Change the electrodes' currents (n, 3, 2, 2), mW, by a function of them and of a size."""
    return {"readings": lambda raw, scene, rng: change_currents(raw, lambda i: change(i, size))}


def add_currents(size: float, every: int) -> Parts:
    """An automatic zero that sets new random offsets after some rows; size: their r.m.s., mW."""

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        draws = size * rng.standard_normal((scene.rows // every + 1, 3, 2, 2))
        offset = np.repeat(draws, every, axis=0)[: scene.rows]
        return change_currents(raw, lambda current: current + offset)

    return {"readings": hook}


def warm_gain(slopes: Floats) -> Parts:
    """The gains of electrodes change with the temperature; slopes: (3, 2, 2) relative, 1/K."""
    return {"readings": lambda raw, scene, rng: change_currents(
        raw, lambda current: current * (1 + np.multiply.outer(scene.air, slopes)))}  # fmt: skip


def scatter(change: Callable[[Floats, Floats, Rng], Floats]) -> Parts:
    """Change readings by a function of them and of their standard deviations (n, 9)."""
    return {"readings": lambda raw, scene, rng: change(
        raw, standard_deviations(scene.real.rig.sensor, raw), rng)}  # fmt: skip


def add_noise(weights: Floats, in_common: bool = False) -> Parts:
    """Add noise, as multiples (9,) of the readings' own; independent, or common to all."""
    return scatter(
        lambda raw, sigma, rng: (
            raw + weights * sigma * rng.standard_normal((len(raw), 1 if in_common else 9))
        )
    )


def jumps(fraction: float, size: float, kind: str) -> Callable[[Floats, Floats, Rng], Floats]:
    """Make a function that shifts the readings (n, 9) in a fraction of the rows by `size` standard
    deviations.

    kind: "rows", all nine of a row; "single", one of the nine; "bursts", those of consecutive rows,
    with the same signs; "detector", the three of detector B.
    """

    def corrupt(raw: Floats, sigma: Floats, rng: Rng) -> Floats:
        count = max(1, round(fraction * len(raw)))
        rows = rng.permutation(len(raw))[:count]
        signs = rng.choice([-1, 1], (count, 9))
        if kind == "bursts":
            rows, signs = np.sort(rows)[0] % (len(raw) - count) + np.arange(count), signs[:1]
        elif kind == "single":
            signs = signs * np.eye(9)[rng.integers(0, 9, count)]
        elif kind == "detector":
            signs = signs * detector_vector(1, [1, 1, 1])
        out = raw.copy()
        out[rows] += size * signs * sigma[rows]
        return out

    return corrupt
