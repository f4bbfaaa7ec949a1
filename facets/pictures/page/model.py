"""The model of one sensor as JavaScript: its numbers, and the texts that they go into."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from importlib.resources import files
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ...characterization import ranges
from ...core.knowledge import BeamKnowledge, Knowledge, PowerKnowledge
from ...core.names import FINE_UNITS
from ...core.rules import Rules
from ...core.sensor import Sensor
from ...detectors import noise
from ...estimation import doubts, plan, step
from ...estimation.problem import Form
from ...estimation.solution import Status
from ...model import arrays
from ...model.kinds import kind_of
from ...optics import (
    bench_gradient,
    bench_light,
    curved_light,
    cut,
    exact_text,
    footprint,
    forward,
    gradient,
    rays,
)
from . import clearance
from .javascript import javascript, literal, name_of
from .rig_data import bodies


class Texts(NamedTuple):
    """The optics' texts of one kind of light.

    linearise: the derivatives with which the solver steps; None for the exact ones.  exact: what
    makes those, for where the others leave terms out, as in `ExactText`.
    """

    readings: Callable[..., Any]
    linearise: Callable[..., Any] | None
    exact: tuple[Callable[..., Any], ...] = ()


CUT = Texts(cut.readings, None, exact_text.CUT)
#: Of ideal light, of truncated light, of a bench's light, and of both.
TEXTS: dict[tuple[bool, bool], Texts] = {
    (False, False): Texts(forward.readings, gradient.linearise),
    (True, False): CUT,
    (False, True): Texts(bench_light.readings, bench_gradient.linearise_nearly, exact_text.BENCH),
    (True, True): CUT,
}
#: The functions with which `light.js` draws.
DRAWN = (
    forward.dark_scene,
    curved_light.apparent_scene,
    rays.hit,
    rays.reflect,
    rays.flight,
    rays.land,
)
#: The functions that `solver.js` and the model call.
SOLVED = (
    arrays.geometry_under,
    forward.replace_power,
    plan.limits_under,
    noise.simple_place_variance,
    noise.simple_power_variance,
    noise.two_layer_place_variance,
    noise.two_layer_power_variance,
    step.ask,
    step.unknown_slopes,
    step.estimate,
    step.residual_of,
    step.covariance_of,
    footprint.footprints,
    clearance.spot_clearance,
    clearance.light_clearance,
    clearance.fullness,
    clearance.saturation_clearance,
    gradient.linearise,
    doubts.sample_sizes,
    forward.sub_beam_height,
    bodies,
)
#: What can be known of beam and power.
BEAM: tuple[BeamKnowledge, ...] = ("free", "known")
POWER: tuple[PowerKnowledge, ...] = ("known", "unknown")
#: What the page's sensor leaves out: it has no part in readings and estimates.
UNUSED = ("correction", "calibration", "thermal", "delays", "drift")
#: The properties of a sensor's parts that the texts read.
PROPERTIES = ("cut", "on", "has_profile")

MODEL = """\
const Model = (() => {{
{numbers}
{texts}

// The sensor as its configuration gives it, and the numbers of a bench's light; mm, rad, mW.
const NOMINAL = {sensor};
const EFFECTS = {effects};
const SOLVER = {solver};
const RANGE = {range};
// Readings with their derivatives by the state, of the kind with which the solver steps.
const linearise = (geometry, state) => {linearise};
// The same with nothing left out, for where steps stall; null where they leave out nothing.
const lineariseExactly = {exactly};

{light}
{noise}
{solving}
{ranging}
// The sensor at rest, as vectors, and what follows from it.
let sensor, geometry, solver, ranges;
const readings = (state) => {readings}(geometry, state).flat();
function change(given) {{
  sensor = given;
  geometry = arrays_geometry_under(sensor, EFFECTS);
  solver = Solver.create(sensor, geometry);
  ranges = Ranges.create(sensor, geometry, readings);
}}
change(NOMINAL);
return {{
  get geometry() {{ return geometry; }},
  // The sensor in use: `Model.change(sensor)` takes another; `Model.nominal` is the first.
  get sensor() {{ return sensor; }},
  nominal: NOMINAL,
  change,
  // The nine readings (psi, zeta, power of a, b, c; mm, mW) at a state (8,); mm, rad.
  readings,
  // What there is to draw at a state; see light.js.
  drawing: (state) => Light.drawing(geometry, state),
  onFacet: Light.onFacet,
  // What rig_data.py writes of the sensor in use, and the height at which a sub-beam passes.
  bodies: () => rig_data_bodies(sensor, geometry),
  height: forward_sub_beam_height,
  // The pose from nine readings; see solver.js.
  solve: (values, options) => solver.solve(values, options),
  refusal: (options) => solver.refusal(options),
  // How far the mirror may go, and why no farther; see range.js.
  causes: Ranges.causes,
  rangeRefusal: RANGE.refusal,
  axisRanges: () => ranges.axes(),
  exit: (way, tolerance) => ranges.exit(way, tolerance),
  clearances: (pose) => ranges.clearances(pose),
  // The standard deviations of nine readings, and readings with noise; see noise.js.
  deviations: (values) => Noise.deviations(sensor, values),
  noisy: (values, seed) => Noise.sample(sensor, values, seed),
  // Whether so much light falls on each detector (3) that it reads nothing.
  saturated: (values) => Noise.saturated(sensor, values),
}};
}})();
"""


#: As `bench_gradient.linearise`, whose variables NumPy makes.
EXACTLY = """(geometry, state) => {{
  const at = {scene}(geometry, state);
  const unit = (n) => state.map((_, c) => (c === n ? 1 : 0));
  const variables = state.map((x, n) => new Dual(x, unit(n)));
  const slopes = {slopes}(geometry, variables, at);
  return zip({readings}(geometry, at), slopes);
}}"""


def text_of(name: str) -> str:
    """Read a file of this folder."""
    return files(__package__).joinpath(name).read_text("utf-8")


def model(sensor: Sensor, rules: Rules | None = None) -> str:
    """Return JavaScript that defines `Model`: readings, drawing, poses and ranges of a sensor.

    rules: of the range; by default those of a configuration that states none.
    """
    texts, exactly = TEXTS[sensor.apertures.cut, sensor.light.on], "null"
    if texts.exact:
        scene, values, slopes = texts.exact
        exactly = EXACTLY.format(
            scene=name_of(scene), readings=name_of(values), slopes=name_of(slopes, True)
        )
    stepping = name_of(texts.linearise) if texts.linearise else f"({exactly})"
    plain = [each for each in (texts.readings, texts.linearise, *texts.exact[:2]) if each]
    return MODEL.format(
        numbers=text_of("numbers.js") + (text_of("dual.js") if texts.exact else ""),
        texts=javascript(*plain, *DRAWN, *SOLVED, carrying=texts.exact[2:]),
        sensor=literal(as_data(sensor)),
        effects=literal(arrays.light_numbers(sensor) if sensor.light.on else None),
        solver=literal(solver_data(sensor)),
        range=literal(range_data(sensor, rules or Rules())),
        ranging=text_of("range.js"),
        light=text_of("light.js"),
        noise=text_of("noise.js"),
        solving=text_of("solver.js"),
        readings=name_of(texts.readings),
        linearise=f"{stepping}(geometry, state)",
        exactly=exactly if texts.linearise else "null",
    )


def as_data(thing: Any) -> Any:
    """Return a sensor or a part of it as dictionaries of its fields, in the units of the code."""
    if isinstance(thing, tuple):
        return tuple(map(as_data, thing))
    if not is_dataclass(thing):
        return thing
    names = [field.name for field in fields(thing) if field.name not in UNUSED]
    names += [name for name in PROPERTIES if hasattr(thing, name)]
    return {name: as_data(getattr(thing, name)) for name in names}


def solver_data(sensor: Sensor) -> dict[str, Any]:
    """The numbers of an estimate that do not change with the sensor's place and size.

    keeps: see `Form`.  plans: by what is known of beam and power.  limits: of the readings.
    noise: see `electronic_noise`.  samples, fold: where the page looks for a fold, and what it then
    says.  refusal: why the page cannot solve; empty where it can.
    """
    limits = plan.make_limits(sensor, False)
    return {
        "keeps": Form((), kind_of(sensor)).keeps_equations,
        "plans": {
            f'"{beam} {power}"': plan_data(sensor, Knowledge(beam=beam, power=power))
            for beam, power in product(BEAM, POWER)
        },
        "limits": {"floor": float(limits.noise[2]), "light": limits.light},
        "samples": doubts.unit_samples().round(9),
        "fold": FOLD,
        "noise": electronic_noise(sensor),
        "statuses": [status.label for status in Status if status < Status.SKIPPED],
        "refusal": refusal(sensor),
    }


def range_data(sensor: Sensor, rules: Rules) -> dict[str, Any]:
    """The limits of the range that do not change with the sensor's place and size."""
    return {
        "causes": ranges.CAUSES,
        "farthest": ranges.FARTHEST_MM_RAD,
        "units": FINE_UNITS,
        "rules": as_data(rules),
        "needed": noise.least_light(sensor, rules.snr),
        "other": noise.other_light(sensor),
        "full": full_light(sensor),
        "no_light": ranges.NO_LIGHT,
        "refusal": range_refusal(sensor),
    }


def full_light(sensor: Sensor) -> float:
    """The light whose current, all into one electrode of a duo-lateral detector, is at the end of
    the amplifier's range, mW; infinite without electronics."""
    electronics = sensor.electronics
    return (
        noise.largest_current(electronics) / (1e-3 * electronics.responsivity)
        if electronics
        else np.inf
    )


def range_refusal(sensor: Sensor) -> str:
    """Say why the page cannot tell the range; empty where it can."""
    if not refusal(sensor):
        return ""
    return (
        "This page cannot tell the range, because it does not know the currents of these "
        "detectors; `facets range-map` does."
    )


def electronic_noise(sensor: Sensor) -> noise.TwoLayerNoise | None:
    """The noise of duo-lateral detectors' currents; None without electronics or with others."""
    electronics = sensor.electronics
    return (
        noise.two_layer_noise(electronics)
        if electronics and noise.has_two_layers(electronics)
        else None
    )


def plan_data(sensor: Sensor, knowledge: Knowledge) -> dict[str, Any]:
    """One plan of `estimation.plan`.

    none: `count_checks` without a detector.  limits: the largest residual by the number of checks.
    power: whether the mean of the power is the sensor's.
    """
    todo = plan.make_plan(sensor, knowledge)
    likely = plan.chance_of(sensor, todo)
    return {
        "means": todo.means[0],
        "power": knowledge.power in ("known", "unknown"),
        "weights": todo.weights,
        "free": todo.free,
        "none": likely.none,
        "limits": likely.limits(np.arange(len(plan.LIMITS), dtype=np.int8)),
    }


FOLD = (
    "Two poses of this sensor can give the same readings. `facets solve` looks for the second one; "
    "this page does not, and shows no pose where the beam's place is unknown."
)


def refusal(sensor: Sensor) -> str:
    """Say why the page cannot solve the readings of a sensor; empty where it can."""
    if sensor.electronics is not None and not noise.has_two_layers(sensor.electronics):
        return (
            f"This page knows the noise of duo-lateral detectors, not of {sensor.electronics.kind} "
            "ones, and so cannot weigh their readings; `facets solve` does."
        )
    return ""
