"""Faults of real benches, of random size, in the light, facets, detectors and electronics of a
sensor, in the reference that it is calibrated with, and in its time base, environment and table.

A fault is a set of hooks, each of which changes one stage of a simulated measurement (`Fault`).
`KINDS` lists the functions that draw faults; sizes come from a logarithmic scale that reaches from
harmless to gross. `unseen_rigs` builds rigs with them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from facets.calibration.fitting.bundle_adjustment import Data, states_of
from facets.core.names import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from facets.core.units import Floats
from facets.detectors.noise import standard_deviations

from . import bench_rays
from .bench_rays import RayBench, RayFacet, facet_light, spots
from .rigs import BOX, REACH_MM, REFERENCE, BenchRig, Rig, Rng

#: Half size of a detector, mm; the power on it at rest, mW; its noise of a place, mm.
HALF_MM, POWER_MW, NOISE_MM = 6.5, 0.1, 2.6e-3
#: Numbers of the places in a reading.
PLACES = np.array([0, 1, 3, 4, 6, 7])
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
REFERENCE_COLUMNS = tuple(f"ref_{name}" for name in STATE_COLUMNS[:6])
#: One mm or mrad of a table in the units of the code.
UNITS = np.array(STATE_UNITS[:6])
#: Half widths of the motion to calibrate with, mm and rad.
BOX_REACH = np.array([REACH_MM, REACH_MM, *BOX[2:]])
#: Room temperature, degrees Celsius.
ROOM_C = 21.3

Columns = dict[str, Floats]
Hook = Callable[[Any, "MotionScene", Rng], Any]
Curve = Callable[["MotionScene", Rng], Floats]


class Fault(NamedTuple):
    """words: what is wrong, as a bench engineer says it.  hooks: changes by stage: scene (its
    temperatures), bench (its RayBench), mirror (true poses), beam (its places), shine (exact
    readings), raw (readings), said (the reference's poses), columns.  in_time: it needs a motion in
    time."""

    group: str
    words: str
    hooks: dict[str, Hook]
    in_time: bool = False


@dataclass
class MotionScene:
    """One motion of a bench.

    pose: (n, 6), of a mirror and reference without faults.  time: s.  warmth, thermometer: the
    temperatures (n,) of the head and of its thermometer over the thermometer's mean, K.  in_use:
    after the calibration.  track: the pose at any time, of a motion in time.  bench, states: as
    built.
    """

    real: BenchRig
    pose: Floats
    time: Floats
    warmth: Floats
    thermometer: Floats
    in_use: bool = False
    has_noise: bool = True
    track: Callable[[Floats], Floats] | None = None
    bench: RayBench | None = None
    states: Floats | None = None

    @property
    def rows(self) -> int:
        return len(self.pose)

    @property
    def share(self) -> Floats:
        """The part of the calibration that has passed (n,): all of it, in use."""
        return np.ones(self.rows) if self.in_use else np.linspace(0, 1, self.rows)

    def shift(self, late: Floats | float) -> Floats:
        """Change (n, 6) of the pose if it is sampled later by `late` seconds."""
        assert self.track is not None
        return self.track(self.time + late) - self.track(self.time)


def sample_states(rig: Rig, pose: Floats, beam: Floats | None = None) -> Floats:
    """States (n, 8) at poses of the reference."""
    places = np.zeros((len(pose), 2)) if beam is None else beam
    empty = np.zeros((len(pose), 9))
    return states_of(Data(empty, pose, REFERENCE, places), empty, rig.values)


# ---- small tools of faults


def size(rng: Rng, low: float, high: float) -> float:
    """A size from a logarithmic scale, the more likely the larger."""
    return float(low * (high / low) ** np.sqrt(rng.uniform()))


def draw_index(rng: Rng, count: int = 3) -> int:
    return int(rng.integers(count))


def unit(rng: Rng, count: int) -> Floats:
    direction: Floats = rng.standard_normal(count)
    return direction / np.linalg.norm(direction)


def um(length: float) -> str:
    return f"{1e3 * length:.3g} um"


def add(direction: Floats, curve: Curve) -> Hook:
    """Add a direction (m,) times a curve (n,)."""
    return lambda values, scene, rng: values + curve(scene, rng)[:, None] * direction


def step(at: float) -> Curve:
    return lambda scene, rng: (scene.share > at).astype(float)


def warmth(scene: MotionScene, rng: Rng) -> Floats:
    return scene.warmth


def ramp(scene: MotionScene, rng: Rng) -> Floats:
    return scene.share - 0.5


def add_pose(change: Callable[[MotionScene, Rng], Floats]) -> Hook:
    """Add a change (n, 6) of the pose."""
    return lambda pose, scene, rng: pose + change(scene, rng)


def hum(per_row: float) -> Curve:
    """A vibration that the rows sample too seldom."""
    return lambda scene, rng: np.sin(
        2 * np.pi * (per_row * np.arange(scene.rows) + rng.uniform())
    )  # fmt: skip


def wander(length: float) -> Curve:
    """Random motion of r.m.s. 1 with a memory of some rows."""

    def curve(scene: MotionScene, rng: Rng) -> Floats:
        keep, out = np.exp(-1 / length), rng.standard_normal(scene.rows)
        for i in range(1, scene.rows):
            out[i] = keep * out[i - 1] + np.sqrt(1 - keep**2) * out[i]
        return out

    return curve


def hops(length: float) -> Curve:
    """Random jumps between 0 and 1, some rows apart."""
    return lambda scene, rng: (np.cumsum(rng.random(scene.rows) < 1 / length) % 2).astype(float)


def previous(values: Floats) -> Floats:
    return np.concatenate([values[:1], values[:-1]])


def low_pass(values: Floats, tau: float, period: float) -> Floats:
    out = values.copy()
    for i in range(1, len(out)):
        out[i] += np.exp(-period / tau) * (out[i - 1] - out[i])
    return out


def add_light(exact: Floats, power: Floats, place: Floats) -> Floats:
    """Add light of powers (n, 3) at places (n, 3, 2) to readings."""
    parts, out = exact.reshape(-1, 3, 3), np.empty((len(exact), 3, 3))
    out[..., 2] = parts[..., 2] + power
    both = parts[..., :2] * parts[..., 2:] + place * power[..., None]
    out[..., :2] = both / out[..., 2:]
    return out.reshape(-1, 9)


def change_currents(raw: Floats, change: Callable[[Floats], Floats]) -> Floats:
    """Change the electrodes' currents (n, 3, 2, 2), in mW: detector, axis, end."""
    parts, out = raw.reshape(-1, 3, 3), np.empty((len(raw), 3, 3))
    ends = np.stack([1 + parts[..., :2] / HALF_MM, 1 - parts[..., :2] / HALF_MM], axis=-1)
    current = change(ends * parts[..., 2, None, None] / 2)
    total = current.sum(axis=-1)
    out[..., :2] = HALF_MM * (current[..., 0] - current[..., 1]) / total
    out[..., 2] = total.mean(axis=-1)
    return out.reshape(-1, 9)


def facet_of(scene: MotionScene, k: int) -> RayFacet:
    assert scene.bench is not None
    assert scene.states is not None
    return bench_rays.facet_of(scene.real.rig.sensor, scene.bench, scene.states, k)


def plane_points(facet: RayFacet, polar: Floats, flat: Floats) -> Floats:
    """Points (m, 3) at places flat (m, 2) about the point at a distance and angle of a facet."""
    basis = np.array([facet.edges[0], facet.inward[0]])
    opening = np.arccos(facet.edges[0] @ facet.edges[1]) * polar[1]
    points: Floats = (polar[0] * np.array([np.cos(opening), np.sin(opening)]) + flat) @ basis
    return points


def lose_patch(k: int, polar: Floats, flat: Floats, area: float, loss: float) -> Hook:
    """Take away a share of the light of a patch of a facet."""

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        facet = facet_of(scene, k)
        points = plane_points(facet, polar, flat)
        power, place, _ = facet_light(facet, points, np.full(len(flat), area / len(flat)))
        powers, places = np.zeros((len(exact), 3)), np.zeros((len(exact), 3, 2))
        powers[:, k], places[:, k] = -loss * power, place
        return add_light(exact, powers, places)

    return hook


# ---- light


def profile_fault(words: str, factor: Callable[[Floats], Floats]) -> Fault:
    return Fault("light", words, {"bench": lambda b, scene, rng: b._replace(profile=factor)})


def cut_beam(rng: Rng) -> Fault:
    ratio, off = rng.uniform(1.2, 2.0), rng.uniform(0, 0.5) * unit(rng, 2)
    words = f"an aperture of {ratio:.2f} times the 1/e^2 radius cuts the beam, " \
            f"{np.linalg.norm(off) / 2:.2f} radii off its centre"  # fmt: skip
    edge = 2 * ratio
    return profile_fault(
        words, lambda p: 1 / (1 + np.exp((np.linalg.norm(p - off, axis=-1) - edge) / 0.06))
    )


def beam_fringes(rng: Rng) -> Fault:
    depth, period, phase = size(rng, 1e-3, 0.03), rng.uniform(0.5, 2.5), rng.uniform(0, 6)
    wave = 2 * np.pi / period * unit(rng, 2)
    words = f"interference fringes of {depth:.2%}, {0.21 * period:.2f} mm apart, across the beam"
    return profile_fault(words, lambda p: 1 + depth * np.cos(p @ wave + phase))


def ring_mode(rng: Rng) -> Fault:
    part = size(rng, 1e-3, 0.05)
    words = f"{part:.2%} of the laser's light is in its first ring mode"
    return profile_fault(words, lambda p: 1 - part + part * (1 - (p**2).sum(-1) / 2) ** 2)


def halo(rng: Rng) -> Fault:
    part = size(rng, 3e-4, 0.03)
    words = f"a halo three times as wide as the beam carries {part:.2%} of its light"
    return profile_fault(
        words, lambda p: 1 - part + part / 9 * np.exp((p**2).sum(-1) * (1 - 1 / 9) / 2)
    )


def window_ghost(rng: Rng) -> Fault:
    part, off = size(rng, 3e-5, 0.01), rng.uniform(0.1, 0.6) * unit(rng, 2)

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        assert scene.states is not None
        assert scene.bench is not None
        beside = scene.states + np.concatenate([np.zeros(6), off])
        ghost = spots(scene.real.rig.sensor, scene.bench, beside).reshape(-1, 3, 3)
        return add_light(exact, part * ghost[..., 2], ghost[..., :2])

    words = f"a window's ghost of {part:.2%} runs {np.linalg.norm(off):.2f} mm beside the beam"
    return Fault("light", words, {"shine": hook})


def mode_hops(rng: Rng) -> Fault:
    jump, length = size(rng, 2e-5, 3e-3), size(rng, 5, 100)
    words = (
        f"the laser hops between two modes some {length:.0f} rows apart; the beam jumps {um(jump)}"
    )
    return Fault("light", words, {"beam": add(jump * unit(rng, 2), hops(length))})


def beam_jump(rng: Rng) -> Fault:
    jump, at = size(rng, 2e-5, 3e-3), rng.uniform(0.2, 0.8)
    words = f"the laser was bumped after {at:.0%} of the rows; the beam jumped {um(jump)}"
    return Fault("light", words, {"beam": add(jump * unit(rng, 2), step(at))})


def fibre_turns(rng: Rng) -> Fault:
    turn = size(rng, 0.01, 0.7)

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        assert scene.states is not None
        assert scene.bench is not None
        other = scene.bench._replace(polarisation=(scene.bench.polarisation or 0.0) + turn)
        end = spots(scene.real.rig.sensor, other, scene.states).reshape(-1, 3, 3)
        dimmed = exact.reshape(-1, 3, 3) * [1, 1, 0]
        dimmed[..., 2] = exact[:, 2::3] * (1 - scene.share)[:, None]
        return add_light(dimmed.reshape(-1, 9), scene.share[:, None] * end[..., 2], end[..., :2])

    words = (
        f"the fibre turns the light's polarisation by {1e3 * turn:.0f} mrad from first to last row"
    )
    return Fault("light", words, {"shine": hook})


# ---- facets


def dust(rng: Rng) -> Fault:
    k, radius, loss = draw_index(rng), size(rng, 0.01, 0.1), rng.uniform(0.4, 1)
    polar = np.array([rng.uniform(0.05, 0.35), rng.uniform(0.2, 0.8)])
    r, turn = np.meshgrid(np.sqrt((np.arange(8) + 0.5) / 8), np.arange(16) * np.pi / 8)
    flat = radius * np.column_stack([(r * np.cos(turn)).ravel(), (r * np.sin(turn)).ravel()])
    words = f"dust of {2e3 * radius:.0f} um lies {polar[0]:.2f} mm from the point on " \
            f"facet {'abc'[k]} and takes {loss:.0%} of its light"  # fmt: skip
    return Fault("facets", words, {"shine": lose_patch(k, polar, flat, np.pi * radius**2, loss)})


def scratch(rng: Rng) -> Fault:
    k, width, length = draw_index(rng), size(rng, 0.5e-3, 0.01), rng.uniform(0.1, 0.4)
    polar = np.array([rng.uniform(0.1, 0.3), rng.uniform(0.3, 0.7)])
    flat = np.outer(np.linspace(-0.5, 0.5, 80) * length, unit(rng, 2))
    words = f"a scratch {um(width)} wide and {length:.2f} mm long on facet {'abc'[k]}"
    return Fault("facets", words, {"shine": lose_patch(k, polar, flat, width * length, 1.0)})


def curved_facet(rng: Rng) -> Fault:
    k, radius = draw_index(rng), size(rng, 1e3, 3e5)
    bend = np.diag(rng.uniform(-1, 1, 2)) / radius

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        facet = facet_of(scene, k)
        points, area, _ = bench_rays.sample_facet(facet)
        basis = np.array([facet.edges[0], facet.inward[0]])
        slope = points @ basis.T @ bend @ basis
        out = exact.copy()
        bent, flat = facet_light(facet, points, area, slope), facet_light(facet, points, area)
        out[:, 3 * k : 3 * k + 2] += bent.place - flat.place
        return out

    words = f"facet {'abc'[k]} is not flat; its radii of curvature are over {radius / 1e3:.3g} m"
    return Fault("facets", words, {"shine": hook})


def tarnish(rng: Rng) -> Fault:
    k, loss = draw_index(rng), size(rng, 2e-3, 0.3)

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        facet = facet_of(scene, k)
        points, area, distances = bench_rays.sample_facet(facet)
        lost = np.minimum(loss * distances[:, 0], 1)
        power, place, _ = facet_light(facet, points, area * lost)
        powers, places = np.zeros((len(exact), 3)), np.zeros((len(exact), 3, 2))
        powers[:, k], places[:, k] = -power, place
        return add_light(exact, powers, places)

    words = f"facet {'abc'[k]} is tarnished and reflects {loss:.1%} less per mm from one edge on"
    return Fault("facets", words, {"shine": hook})


def chipped_point(rng: Rng) -> Fault:
    radius = size(rng, 2e-3, 0.05)
    words = f"a piece of {um(radius)} is broken off the point of facets a and b"
    return Fault("facets", words, {"bench": lambda b, scene, rng: b._replace(chip=radius)})


def yielding_facet(rng: Rng) -> Fault:
    k, share, axis = draw_index(rng), size(rng, 2e-5, 5e-3), 3 + draw_index(rng)
    turn = 2 * 250 * share * unit(rng, 2)

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        out = exact.copy()
        out[:, 3 * k : 3 * k + 2] += scene.pose[:, axis, None] * turn
        return out

    words = f"the mirror is not rigid: facet {'abc'[k]} yields by {1e3 * share:.3g} urad " \
            f"per mrad of {AXES[axis]}"  # fmt: skip
    return Fault("facets", words, {"shine": hook})


def slipped_facet(rng: Rng) -> Fault:
    k, angle, at = draw_index(rng), size(rng, 1e-6, 2e-4), rng.uniform(0.2, 0.8)
    moved = np.zeros(9)
    moved[3 * k : 3 * k + 2] = 2 * 250 * angle * unit(rng, 2)
    words = f"facet {'abc'[k]} slips by {1e6 * angle:.3g} urad after {at:.0%} of the rows"
    return Fault("facets", words, {"shine": add(moved, step(at))})


def facet_scatter(rng: Rng) -> Fault:
    share, k, place = size(rng, 1e-5, 0.01), draw_index(rng), rng.uniform(-3, 3, 2)

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        powers, places = np.zeros((len(exact), 3)), np.zeros((len(exact), 3, 2))
        powers[:, k], places[:, k] = share * exact[:, 3 * ((k + 1) % 3) + 2], place
        return add_light(exact, powers, places)

    words = f"facet {'bca'[k]} scatters {share:.3%} of its light onto detector {'abc'[k]}"
    return Fault("facets", words, {"shine": hook})


# ---- detectors


def creeping_glue(rng: Rng) -> Fault:
    k, far = draw_index(rng), size(rng, 1e-4, 0.04)
    moved = np.zeros(9)
    moved[3 * k : 3 * k + 2] = far / np.log(1 + 50) * unit(rng, 2)
    words = f"the glue of detector {'abc'[k]} creeps by {um(far)}, as the logarithm of time"
    return Fault(
        "detectors", words, {"shine": add(moved, lambda scene, rng: np.log(1 + 50 * scene.share))}
    )


def knocked_detector(rng: Rng) -> Fault:
    k, far, at = draw_index(rng), size(rng, 5e-4, 0.1), rng.uniform(0.2, 0.8)
    moved = np.zeros(9)
    moved[3 * k : 3 * k + 2] = far * unit(rng, 2)
    words = f"detector {'abc'[k]} was knocked {um(far)} aside after {at:.0%} of the rows"
    return Fault("detectors", words, {"shine": add(moved, step(at))})


def place_error(k: int, function: Callable[[Floats], Floats]) -> Hook:
    """Add a function of the places (n, 2) of a detector to them."""

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        out = exact.copy()
        out[:, 3 * k : 3 * k + 2] += function(exact[:, 3 * k : 3 * k + 2])
        return out

    return hook


def blemish(rng: Rng) -> Fault:
    k, far, width = draw_index(rng), size(rng, 1e-3, 0.1), rng.uniform(0.4, 1.5)
    middle, moved = rng.uniform(-2.5, 2.5, 2), far * unit(rng, 2)
    hook = place_error(
        k,
        lambda p: np.exp(-(((p - middle) / width) ** 2).sum(axis=1) / 2)[:, None] * moved,
    )
    words = f"a blemish of detector {'abc'[k]}, {width:.1f} mm wide, shifts places by {um(far)}"
    return Fault("detectors", words, {"shine": hook})


def window_fringes(rng: Rng) -> Fault:
    k, far, period = draw_index(rng), size(rng, 5e-4, 0.03), rng.uniform(0.4, 3)
    wave, moved = 2 * np.pi / period * unit(rng, 2), far * unit(rng, 2)
    hook = place_error(k, lambda p: np.sin(p @ wave)[:, None] * moved)
    words = f"fringes in the window of detector {'abc'[k]} shift places by {um(far)} in " \
            f"periods of {period:.1f} mm"  # fmt: skip
    return Fault("detectors", words, {"shine": hook})


def high_order(rng: Rng) -> Fault:
    k, far, signs = draw_index(rng), size(rng, 1e-3, 0.15), rng.uniform(-1, 1, 2)

    def function(place: Floats) -> Floats:
        y, z = (place / HALF_MM).T
        return far * np.column_stack([y**5 + signs[0] * y * z**4, z**5 + signs[1] * z * y**4])

    words = f"detector {'abc'[k]} has an error of fifth order, {um(far)} at its edge"
    return Fault("detectors", words, {"shine": place_error(k, function)})


def power_bends_place(rng: Rng) -> Fault:
    share, k = size(rng, 1e-5, 5e-3), draw_index(rng)

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        out = exact.copy()
        brighter = exact[:, 3 * k + 2, None] / POWER_MW - 1
        out[:, 3 * k : 3 * k + 2] *= 1 + share * brighter
        return out

    words = f"the scale of detector {'abc'[k]} changes by {share:.3%} from no light to 0.1 mW"
    return Fault("detectors", words, {"shine": hook})


def memory(rng: Rng) -> Fault:
    share, k = size(rng, 1e-5, 0.01), draw_index(rng)

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        out = raw.copy()
        part = slice(3 * k, 3 * k + 3)
        out[:, part] += share * (previous(raw) - raw)[:, part]
        return out

    words = f"detector {'abc'[k]} remembers {share:.3%} of its last reading"
    return Fault("detectors", words, {"raw": hook})


# ---- electronics


def current_fault(words: str, change: Callable[[Floats], Floats]) -> Fault:
    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        return change_currents(raw, change)

    return Fault("electronics", words, {"raw": hook})


def bent_amplifiers(rng: Rng) -> Fault:
    bend = size(rng, 1e-4, 0.03)
    each = bend * rng.uniform(-1, 1, (3, 2, 2))
    words = f"the amplifiers bend by up to {bend:.2%} at full light, each its own way"
    return current_fault(words, lambda i: i * (1 + each * i / POWER_MW))


def converter_step(rng: Rng) -> Fault:
    jump, k = size(rng, 1e-7, 3e-4), draw_index(rng)
    axis, end = draw_index(rng, 2), draw_index(rng, 2)

    def change(current: Floats) -> Floats:
        out = current.copy()
        out[:, k, axis, end] += jump * (current[:, k, axis, end] > 0.032)
        return out

    return current_fault(
        f"a converter of detector {'abc'[k]} has a step of {1e6 * jump:.3g} nW in its middle",
        change,
    )


def saturation(rng: Rng) -> Fault:
    limit = rng.uniform(0.06, 0.12)
    words = f"the amplifiers saturate at {1e3 * limit:.0f} uW per electrode"
    return current_fault(words, lambda i: limit - np.logaddexp(0, (limit - i) / 2e-4) * 2e-4
                         + np.log1p(np.exp(-limit / 2e-4)) * 2e-4)  # fmt: skip


def crosstalk(rng: Rng) -> Fault:
    share = size(rng, 1e-6, 0.01)
    words = f"{share:.4%} of the currents of each detector leak into the next one's channels"
    return current_fault(words, lambda i: i + share * np.roll(i, 1, axis=1))


def warm_gain(rng: Rng) -> Fault:
    share, k = size(rng, 1e-5, 3e-3), draw_index(rng)
    axis, end = draw_index(rng, 2), draw_index(rng, 2)

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        gain = np.ones((scene.rows, 3, 2, 2))
        gain[:, k, axis, end] += share * scene.warmth
        return change_currents(raw, lambda i: i * gain)

    words = f"the gain of one electrode of detector {'abc'[k]} changes by {share:.3%}/K"
    return Fault("electronics", words, {"raw": hook, "columns": show_temperature}, True)


def dark_steps(rng: Rng) -> Fault:
    far = size(rng, 1e-7, 2e-4)

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        every = rng.standard_normal((scene.rows // 80 + 1, 3, 2, 2))
        dark = far * np.repeat(every, 80, axis=0)[: scene.rows]
        return change_currents(raw, lambda i: i + dark)

    words = f"an automatic zero sets new offsets of {1e6 * far:.3g} nW every 80 rows"
    return Fault("electronics", words, {"raw": hook})


def common_noise(rng: Rng) -> Fault:
    far, shares = size(rng, 0.2, 4.0), rng.uniform(0.5, 1, 6) * rng.choice([-1, 1], 6)
    places = np.zeros(9)
    places[PLACES] = far * NOISE_MM * shares
    words = f"a common supply adds {far:.2f} times the noise to all places together"
    return Fault(
        "electronics", words, {"raw": add(places, lambda s, rng: rng.standard_normal(s.rows))}
    )


def noisy_detector(rng: Rng) -> Fault:
    factor, k = size(rng, 1.1, 6), draw_index(rng)

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        sigma = standard_deviations(scene.real.rig.sensor, raw)
        sigma[:, [i for i in range(9) if i // 3 != k]] = 0
        more: Floats = np.sqrt(factor**2 - 1) * sigma * rng.standard_normal(raw.shape)
        return raw + more

    words = f"detector {'abc'[k]} has {factor:.2f} times the stated noise"
    return Fault("electronics", words, {"raw": hook})


def supply_hum(rng: Rng) -> Fault:
    far, places = size(rng, 2e-4, 0.02), np.zeros(9)
    places[PLACES] = far * rng.uniform(-1, 1, 6)
    words = f"mains hum of up to {um(far)} on all places, undersampled"
    return Fault("electronics", words, {"raw": add(places, hum(rng.uniform(0.03, 0.5)))})


def microphonics(rng: Rng) -> Fault:
    far, number, limit = size(rng, 1e-3, 0.1), rng.choice(PLACES), rng.uniform(0.5, 0.9)

    def hook(raw: Floats, scene: MotionScene, rng: Rng) -> Floats:
        move = np.linalg.norm((scene.pose - previous(scene.pose)) / BOX, axis=1)
        out = raw.copy()
        shaken = move > np.quantile(move, limit)
        out[:, number] += far * shaken * rng.standard_normal(scene.rows)
        return out

    words = f"a cable's microphonics add {um(far)} to {READING_COLUMNS[number]} after the " \
            f"{1 - limit:.0%} fastest moves"  # fmt: skip
    return Fault("electronics", words, {"raw": hook})


# ---- reference


def matrix_error(words: str, matrix: Floats) -> Fault:
    """A reference that adds a matrix (6, 6) times the pose."""
    return Fault("reference", words, {"said": add_pose(lambda s, rng: s.pose @ matrix.T)})


def lagging_stage(rng: Rng) -> Fault:
    share = size(rng, 1e-5, 0.01)
    words = f"the mirror stays behind the stage by {share:.3%} of each move"
    hook = add_pose(lambda scene, rng: share * (previous(scene.pose) - scene.pose))
    return Fault("reference", words, {"mirror": hook})


def abbe(rng: Rng) -> Fault:
    far, matrix = size(rng, 3e-3, 5), np.zeros((6, 6))
    arms = far * rng.uniform(-1, 1, (3, 3))
    for i, arm in enumerate(arms):
        for j in range(3):
            matrix[i, 3 + j] = np.cross(np.eye(3)[j], arm)[i]
    words = f"Abbe: each axis is measured along its own line, up to {far:.3g} mm off the pivot"
    return matrix_error(words, matrix)


def scale_error(rng: Rng) -> Fault:
    far, count = size(rng, 1e-5, 0.01), rng.integers(1, 4)
    errors = np.zeros(6)
    which = rng.choice(6, count, replace=False)
    errors[which] = far * rng.uniform(0.5, 1, count) * rng.choice([-1, 1], count)
    named = ", ".join(f"{AXES[i]} {errors[i]:+.3%}" for i in which)
    return matrix_error(f"scale errors of the reference: {named}", np.diag(errors))


def squareness(rng: Rng) -> Fault:
    angle, matrix = size(rng, 1e-5, 5e-3), np.zeros((6, 6))
    i, j = rng.choice(3, 2, replace=False)
    matrix[i, j] = angle
    words = f"the reference's {AXES[i]} and {AXES[j]} are {1e3 * angle:.3g} mrad out of square"
    return matrix_error(words, matrix)


def angle_crosstalk(rng: Rng) -> Fault:
    share, matrix = size(rng, 1e-4, 0.02), np.zeros((6, 6))
    i, j = 3 + rng.choice(3, 2, replace=False)
    matrix[i, j] = share
    words = f"cosine error: the reference's {AXES[i]} holds {share:.2%} of {AXES[j]}"
    return matrix_error(words, matrix)


def bow(rng: Rng) -> Fault:
    i, j = rng.choice(3, 2, replace=False)
    far = size(rng, 3e-5, 0.01)
    hook = add(far * np.eye(6)[i], lambda s, rng: (s.pose[:, j] / BOX_REACH[j]) ** 2)
    words = f"the reference's {AXES[i]} bows by {um(far)} over the travel in {AXES[j]}"
    return Fault("reference", words, {"said": hook})


def cyclic_error(rng: Rng) -> Fault:
    i, far, period = draw_index(rng), size(rng, 3e-6, 1e-3), rng.choice([633e-6 / 2, 0.02, 0.5])
    hook = add(far * np.eye(6)[i], lambda s, rng: np.sin(2 * np.pi * s.pose[:, i] / period))
    words = f"the reference's {AXES[i]} has a cyclic error of {um(far)}, period {um(period)}"
    return Fault("reference", words, {"said": hook})


def missed_counts(rng: Rng) -> Fault:
    i, count, part = draw_index(rng), rng.integers(1, 6), rng.choice([1, 4, 40])
    at, signs = rng.random(count), rng.choice([-1, 1], count)
    jump = 633e-6 / 8 * part

    def hook(said: Floats, scene: MotionScene, rng: Rng) -> Floats:
        late = (scene.share[:, None] > at) @ (signs * jump)
        return said + np.outer(late, np.eye(6)[i])

    words = f"the interferometer of {AXES[i]} misses counts {count} times, {um(jump)} each"
    return Fault("reference", words, {"said": hook})


def backlash(rng: Rng) -> Fault:
    i, far = draw_index(rng, 6), size(rng, 0.05, 20)
    moved = 1e-3 * far * UNITS[i] * np.eye(6)[i] / 2

    def hook(pose: Floats, scene: MotionScene, rng: Rng) -> Floats:
        behind: Floats = np.sign(pose - previous(pose)) * moved
        return pose - behind

    unit_name = "um" if i < 3 else "urad"
    words = f"the stage has a backlash of {far:.3g} {unit_name} in {AXES[i]}"
    return Fault("reference", words, {"mirror": hook})


def glitches(rng: Rng) -> Fault:
    share, far, i = size(rng, 4e-3, 0.08), size(rng, 1, 200), draw_index(rng, 6)

    def hook(said: Floats, scene: MotionScene, rng: Rng) -> Floats:
        hit = (rng.random(scene.rows) < share) * rng.standard_normal(scene.rows)
        return said + np.outer(hit, 1e-3 * far * UNITS[i] * np.eye(6)[i])

    words = f"the reference's {AXES[i]} glitches by {far:.3g} um or urad in {share:.1%} of the rows"
    return Fault("reference", words, {"said": hook})


def noisy_reference(rng: Rng) -> Fault:
    factor = size(rng, 1.2, 20)
    more = np.sqrt(factor**2 - 1) * REFERENCE
    hook = add_pose(lambda scene, rng: more * rng.standard_normal(scene.pose.shape))
    words = f"the reference has {factor:.1f} times the stated noise"
    return Fault("reference", words, {"said": hook})


# ---- time


def time_fault(words: str, late: Curve) -> Fault:
    """A reference that is sampled later than the readings, by a curve in s."""
    hook = add_pose(lambda scene, rng: scene.shift(late(scene, rng)))
    return Fault("time", words, {"said": hook}, True)


def clock_rate(rng: Rng) -> Fault:
    rate = size(rng, 1e-7, 1e-3) * rng.choice([-1, 1])
    words = f"the reference's clock runs off by {1e6 * rate:+.3g} ppm"
    return time_fault(words, lambda scene, rng: rate * scene.time)


def clock_jitter(rng: Rng) -> Fault:
    far = size(rng, 1e-5, 0.03)
    words = f"the reference's samples jitter by {1e3 * far:.3g} ms"
    return time_fault(words, lambda scene, rng: far * rng.standard_normal(scene.rows))


def delay_step(rng: Rng) -> Fault:
    late, at = size(rng, 1e-4, 0.3), rng.uniform(0.2, 0.8)
    words = f"a buffer delays the reference by {1e3 * late:.3g} ms more after {at:.0%} of the rows"
    return time_fault(words, lambda scene, rng: np.where(scene.share > at, late, 0.0))


def common_delay(rng: Rng) -> Fault:
    late = size(rng, 1e-4, 0.3)
    words = f"the reference is {1e3 * late:.3g} ms late throughout"
    return time_fault(words, lambda scene, rng: np.full(scene.rows, -late))


def slow_reference(rng: Rng) -> Fault:
    tau = size(rng, 1e-3, 1.0)
    nodes, weights = np.polynomial.laguerre.laggauss(8)

    def hook(said: Floats, scene: MotionScene, rng: Rng) -> Floats:
        for node, weight in zip(nodes, weights, strict=True):
            said = said + weight * scene.shift(-tau * node)
        return said

    words = f"the reference's low-pass filter has a time constant of {1e3 * tau:.3g} ms"
    return Fault("time", words, {"said": hook}, True)


def late_detector(rng: Rng) -> Fault:
    k, late = draw_index(rng), size(rng, 1e-4, 0.2)

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        assert scene.states is not None
        assert scene.bench is not None
        rig, out = scene.real.rig, exact.copy()
        there = sample_states(rig, scene.pose + scene.shift(late)) - sample_states(rig, scene.pose)
        part = slice(3 * k, 3 * k + 3)
        out[:, part] = spots(rig.sensor, scene.bench, scene.states + there)[:, part]
        return out

    words = f"detector {'abc'[k]} is read {1e3 * late:.3g} ms after the others"
    return Fault("time", words, {"shine": hook}, True)


def dropped_frame(rng: Rng) -> Fault:
    at, length = rng.uniform(0.2, 0.8), rng.uniform(0.05, 0.3)

    def hook(said: Floats, scene: MotionScene, rng: Rng) -> Floats:
        late = (scene.share > at) & (scene.share < at + length)
        return np.where(late[:, None], previous(said), said)

    words = f"a frame was dropped: the reference is one row late for {length:.0%} of the rows"
    return Fault("time", words, {"said": hook}, True)


def clock_set(rng: Rng) -> Fault:
    jump, at = rng.choice([3.0, 60.0, 3600.0]), rng.uniform(0.2, 0.8)

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        return columns | {"time_s": scene.time + jump * (scene.share > at)}

    words = f"the computer's clock was set {jump:.0f} s forward after {at:.0%} of the rows"
    return Fault("time", words, {"columns": hook}, True)


# ---- environment


def show_temperature(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
    rows = columns["row"].astype(int)
    return columns | {"temperature_c": np.round(ROOM_C + scene.thermometer[rows], 3)}


def lamp(rng: Rng) -> Fault:
    power, at = size(rng, 1e-6, 3e-3), rng.uniform(0.2, 0.8)
    curves: dict[str, Curve] = {
        "is switched on": step(at),
        "is switched off": lambda scene, rng: (scene.share < at).astype(float),
        "flickers on and off": hops(rng.uniform(1, 30)),
        "grows brighter": lambda scene, rng: scene.share**2,
    }
    kind = str(rng.choice(list(curves)))
    curve = curves[kind]
    each, place = power * rng.uniform(0.1, 1, 3), rng.uniform(-3, 3, (3, 2))

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        shape = (len(exact), 3, 2)
        light = curve(scene, rng)[:, None] * each
        return add_light(exact, light, np.broadcast_to(place, shape))

    words = f"background light of {1e6 * power:.3g} nW {kind} (row share {at:.0%})"
    return Fault("environment", words, {"shine": hook})


def warm_posts(rng: Rng) -> Floats:
    """Drift of the readings (9,), mm/K, by the detectors' posts."""
    moved = np.zeros(9)
    moved[PLACES] = size(rng, 3e-4, 0.015) * rng.uniform(-1, 1, 6)
    return moved


def slow_thermometer(rng: Rng) -> Fault:
    tau, leads, moved = size(rng, 1, 200), rng.random() < 0.5, warm_posts(rng)

    def delay(scene: MotionScene, _: MotionScene, rng: Rng) -> MotionScene:
        late = low_pass(scene.warmth, tau, scene.time[1] - scene.time[0])
        first, second = (late, scene.warmth) if leads else (scene.warmth, late)
        return replace(scene, warmth=first - second.mean(), thermometer=second - second.mean())

    words = f"posts drift by {um(np.abs(moved).max())}/K; the thermometer " \
            f"{'leads' if leads else 'lags'} by {tau:.0f} s"  # fmt: skip
    hooks: dict[str, Hook] = {
        "scene": delay,
        "shine": add(moved, warmth),
        "columns": show_temperature,
    }
    return Fault("environment", words, hooks, True)


def warm_beam(rng: Rng) -> Fault:
    far = size(rng, 3e-5, 5e-3)
    hooks: dict[str, Hook] = {"beam": add(far * unit(rng, 2), warmth), "columns": show_temperature}
    words = f"the beam drifts by {um(far)}/K, and the thermometer is right"
    return Fault("environment", words, hooks, True)


def unseen_warmth(rng: Rng) -> Fault:
    moved = warm_posts(rng)
    words = f"posts drift by up to {um(np.abs(moved).max())}/K, without a temperature in the table"
    return Fault("environment", words, {"shine": add(moved, warmth)}, True)


def warm_holder(rng: Rng) -> Fault:
    far = size(rng, 1e-5, 5e-3)
    moved = far * unit(rng, 6) * [1, 1, 1, 1e-2, 1e-2, 1e-2]
    words = f"the mirror's holder moves it by {um(far)}/K on the stage"
    return Fault("environment", words, {"mirror": add(moved, warmth)}, True)


def vibration(rng: Rng) -> Fault:
    far, per_row = size(rng, 1e-5, 5e-3), rng.uniform(0.03, 0.5)
    moved = far * unit(rng, 6) * [1, 1, 1, 5e-3, 5e-3, 5e-3]
    words = f"the mirror vibrates by {um(far)} and {5e3 * far:.3g} urad, undersampled by the rows"
    return Fault("environment", words, {"mirror": add(moved, hum(per_row))})


def beam_vibration(rng: Rng) -> Fault:
    far = size(rng, 1e-5, 2e-3)
    words = f"the laser vibrates: the beam moves by {um(far)}, undersampled by the rows"
    hook = add(far * unit(rng, 2), hum(rng.uniform(0.03, 0.5)))
    return Fault("environment", words, {"beam": hook})


def turbulence(rng: Rng) -> Fault:
    far, length, places = size(rng, 2e-4, 0.02), size(rng, 1, 60), np.zeros(9)
    places[PLACES] = far * rng.uniform(0.3, 1, 6)
    curves = [add(part * places, wander(length)) for part in np.eye(9)[PLACES]]

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        for curve in curves:
            exact = curve(exact, scene, rng)
        return exact

    words = f"warm air moves spots by up to {um(far)}, with a memory of {length:.0f} rows"
    return Fault("environment", words, {"shine": hook})


def sagging_table(rng: Rng) -> Fault:
    far = size(rng, 3e-5, 5e-3)
    words = f"the laser's mount sags: the beam drifts by {um(far)} from first to last row"
    return Fault("environment", words, {"beam": add(far * unit(rng, 2), ramp)})


def leaning_person(rng: Rng) -> Fault:
    far, at, tau = size(rng, 5e-7, 2e-4), rng.uniform(0.2, 0.7), rng.uniform(0.02, 0.1)
    moved = far * np.concatenate([np.zeros(3), unit(rng, 2), [0]])

    def curve(scene: MotionScene, rng: Rng) -> Floats:
        since = (scene.share - at) / tau
        return np.where(since > 0, np.exp(-np.maximum(since, 0)), 0)

    words = (
        f"somebody leans on the table at row share {at:.0%}: the mirror tilts {1e6 * far:.3g} urad"
    )
    return Fault("environment", words, {"mirror": add(moved, curve)})


def fog(rng: Rng) -> Fault:
    loss = rng.uniform(0.05, 0.5)

    def hook(exact: Floats, scene: MotionScene, rng: Rng) -> Floats:
        out = exact.copy()
        out[:, 2::3] *= (1 - loss * scene.share)[:, None]
        return out

    words = f"fog on the laser's window takes {loss:.0%} of the light by the last row"
    return Fault("environment", words, {"shine": hook})


# ---- table


def part_of(rng: Rng) -> tuple[float, float]:
    first = rng.uniform(0, 0.8)
    return first, first + size(rng, 0.02, 0.5)


def rows_of(scene: MotionScene, part: tuple[float, float]) -> np.ndarray[Any, np.dtype[np.bool_]]:
    return (scene.share >= part[0]) & (scene.share < part[1])


def table_fault(words: str, change: Hook) -> Fault:
    return Fault("table", words, {"columns": change})


def swapped_columns(rng: Rng) -> Fault:
    part, names = part_of(rng), list(READING_COLUMNS if rng.random() < 0.5 else REFERENCE_COLUMNS)
    first = rng.choice([0, 3, 6] if len(names) == 9 else [0, 3])
    one, other = names[first], names[first + 1]

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        rows = rows_of(scene, part)
        swapped = {one: np.where(rows, columns[other], columns[one]),
                   other: np.where(rows, columns[one], columns[other])}  # fmt: skip
        return columns | swapped

    share = min(part[1], 1) - part[0]
    return table_fault(f"{one} and {other} are exchanged in {share:.0%} of the rows", hook)


def scaled_column(words: str, name: str, factor: float, part: tuple[float, float]) -> Fault:
    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        return columns | {name: columns[name] * np.where(rows_of(scene, part), factor, 1)}

    share = min(part[1], 1) - part[0]
    return table_fault(f"{name} {words} in {share:.0%} of the rows", hook)


def changed_unit(rng: Rng) -> Fault:
    name = str(rng.choice([*REFERENCE_COLUMNS[3:], "power_a_mw", "ref_tz_mm"]))
    factor, label = (3.43775, "arc minutes") if "mrad" in name else (1e3, "thousandths")
    return scaled_column(f"is given in {label}", name, factor, part_of(rng))


def changed_sign(rng: Rng) -> Fault:
    name = str(rng.choice([*REFERENCE_COLUMNS, *np.array(READING_COLUMNS)[PLACES]]))
    return scaled_column("has the wrong sign", name, -1.0, part_of(rng))


def rounded_reference(rng: Rng) -> Fault:
    grid = rng.choice([1e-4, 1e-3, 1e-2])

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        return columns | {n: grid * np.round(columns[n] / grid) for n in REFERENCE_COLUMNS}

    return table_fault(f"the reference is written in steps of {1e3 * grid:g} um and urad", hook)


def rounded_readings(rng: Rng) -> Fault:
    grid = rng.choice([1e-3, 5e-3, 1e-2, 2e-2])

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        names = np.array(READING_COLUMNS)[PLACES]
        return columns | {n: grid * np.round(columns[n] / grid) for n in names}

    return table_fault(f"the places are written in steps of {um(grid)}", hook)


def take_rows(order: Callable[[MotionScene, Rng], Any]) -> Hook:
    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        rows = order(scene, rng)
        return {name: column[rows] for name, column in columns.items()}

    return hook


def duplicated_block(rng: Rng) -> Fault:
    part = part_of(rng)

    def order(scene: MotionScene, rng: Rng) -> Any:
        return np.concatenate([np.arange(scene.rows), np.flatnonzero(rows_of(scene, part))])

    share = min(part[1], 1) - part[0]
    return table_fault(f"a block of {share:.0%} of the rows stands twice", take_rows(order))


def rows_out_of_order(rng: Rng) -> Fault:
    words = "the rows were sorted by tx, whole rows, before they were saved"
    return table_fault(words, take_rows(lambda scene, rng: np.argsort(scene.pose[:, 0])))


def slipped_reference(rng: Rng) -> Fault:
    first, length = rng.uniform(0.1, 0.8), size(rng, 0.01, 0.2)

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        rows = rows_of(scene, (first, first + length))
        return columns | {n: np.where(rows, previous(columns[n]), columns[n])
                          for n in REFERENCE_COLUMNS}  # fmt: skip

    words = f"the reference's columns slipped down by one row in {length:.1%} of the rows"
    return table_fault(words, hook)


def stale_readings(rng: Rng) -> Fault:
    share = size(rng, 5e-3, 0.1)

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        stale = rng.random(scene.rows) < share
        return columns | {n: np.where(stale, previous(columns[n]), columns[n])
                          for n in READING_COLUMNS}  # fmt: skip

    return table_fault(f"{share:.1%} of the readings are those of the row before", hook)


def pasted_sessions(rng: Rng) -> Fault:
    far, at = size(rng, 0.03, 100), rng.uniform(0.2, 0.8)
    moved = far * unit(rng, 6) * 1e-3

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        later = scene.share > at
        return columns | {name: columns[name] + by * later
                          for name, by in zip(REFERENCE_COLUMNS, moved, strict=True)}  # fmt: skip

    words = f"two sessions are pasted; the reference's zero moved by {far:.3g} um and urad between"
    return table_fault(words, hook)


def lost_point(rng: Rng) -> Fault:
    count, name = rng.integers(1, 8), str(rng.choice([*REFERENCE_COLUMNS, *READING_COLUMNS]))

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        rows = rng.permutation(scene.rows) < count
        return columns | {name: np.where(rows, 10, 1) * columns[name]}

    return table_fault(f"{count} numbers of {name} have lost their decimal point (times 10)", hook)


def angle_order(rng: Rng) -> Fault:
    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        names = REFERENCE_COLUMNS[3:]
        angles = np.column_stack([columns[name] for name in names])
        turned = Rotation.from_euler("xyz", 1e-3 * angles)  # about fixed axes, x first
        said = 1e3 * turned.as_euler("zyx")[:, ::-1]
        return columns | dict(zip(names, said.T, strict=True))

    return table_fault("the stage turns about its axes in the other order than the table's", hook)


def smoothed_readings(rng: Rng) -> Fault:
    rows = int(rng.choice([3, 5]))

    def hook(columns: Columns, scene: MotionScene, rng: Rng) -> Columns:
        out, side = dict(columns), rows // 2
        for name in READING_COLUMNS:
            wide = np.pad(columns[name], side, mode="reflect", reflect_type="odd")
            out[name] = np.convolve(wide, np.full(rows, 1 / rows), mode="valid")
        return out

    words = f"the readings were smoothed over {rows} rows before they were saved"
    return Fault("table", words, {"columns": hook}, True)


#: All kinds of fault.
KINDS: tuple[Callable[[Rng], Fault], ...] = (
    cut_beam, beam_fringes, ring_mode, halo, window_ghost, mode_hops, beam_jump, fibre_turns,
    dust, scratch, curved_facet, tarnish, chipped_point, yielding_facet, slipped_facet,
    facet_scatter, creeping_glue, knocked_detector, blemish, window_fringes, high_order,
    power_bends_place, memory, bent_amplifiers, converter_step, saturation, crosstalk, warm_gain,
    dark_steps, common_noise, noisy_detector, supply_hum, microphonics, lagging_stage, abbe,
    scale_error, squareness, angle_crosstalk, bow, cyclic_error, missed_counts, backlash, glitches,
    noisy_reference, clock_rate, clock_jitter, delay_step, common_delay, slow_reference,
    late_detector, dropped_frame, clock_set, lamp, slow_thermometer, warm_beam, unseen_warmth,
    warm_holder, vibration, beam_vibration, turbulence, sagging_table, leaning_person, fog,
    swapped_columns, changed_unit, changed_sign, rounded_reference, rounded_readings,
    duplicated_block, rows_out_of_order, slipped_reference, stale_readings, pasted_sessions,
    lost_point, angle_order, smoothed_readings,
)  # fmt: skip
