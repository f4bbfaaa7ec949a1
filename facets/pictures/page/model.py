"""The model of one sensor as JavaScript: its numbers and its functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import partial
from importlib.resources import files
from itertools import product
from typing import Any

import numpy as np

from ...characterization import ranges
from ...core.knowledge import BeamKnowledge, Knowledge, PowerKnowledge
from ...core.names import FINE_UNITS
from ...core.rules import Rules
from ...core.sensor import Sensor
from ...detectors import noise
from ...estimation import doubts, plan, step
from ...estimation.problem import ROUNDING, SCALES, Form
from ...estimation.solution import Status
from ...model import arrays
from ...model.kinds import kind_of
from ...optics import (
    bench_gradient,
    curved_light,
    exact_text,
    footprint,
    forward,
    gradient,
    rays,
)
from ...optics.effects import LightEffects
from ...scalars.dual import Dual
from ..stills.scene import RIM_MM
from .javascript import javascript, literal

#: The functions of the optics for light that apertures cut or do not, and ideal light or a bench's.
TEXTS: dict[tuple[bool, bool], exact_text.ExactText] = {
    (False, False): exact_text.IDEAL,
    (True, False): exact_text.CUT,
    (False, True): exact_text.BENCH,
    (True, True): exact_text.CUT,
}
#: Examples of arguments of functions, see `javascript.javascript`.
NUMBER, VECTOR, STATE, NINE = 0.0, (0.0,) * 3, (0.0,) * 8, (0.0,) * 9
MATRIX, DETECTORS = (VECTOR,) * 3, ((VECTOR, (STATE,) * 3),) * 3
ELECTRONIC, SIMPLE = noise.TwoLayerNoise(*VECTOR), {"position": 0.0, "at_power": 0.0, "power": 0.0}
#: The functions that `light.js`, `noise.js` and the model call, by their names there, with examples
#: of their arguments.
FUNCTIONS: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
    "hit": (rays.hit, (VECTOR,) * 4),
    "reflect": (rays.reflect, (VECTOR,) * 2),
    "flight": (rays.flight, (VECTOR, VECTOR, VECTOR, MATRIX)),
    "land": (rays.land, (VECTOR, VECTOR, NUMBER, VECTOR, MATRIX)),
    "mirrorEdges": (forward.mirror_edges, (MATRIX,)),
    "subBeamHeight": (forward.sub_beam_height, (NUMBER, NUMBER)),
    "simplePlaceVariance": (noise.simple_place_variance, (SIMPLE, NUMBER)),
    "simplePowerVariance": (noise.simple_power_variance, (SIMPLE, NUMBER)),
    "twoLayerPlaceVariance": (noise.two_layer_place_variance, (*VECTOR, ELECTRONIC)),
    "twoLayerPowerVariance": (noise.two_layer_power_variance, (NUMBER, ELECTRONIC)),
}
#: The words for the knowledge of the beam's place and of the power.
BEAM: tuple[BeamKnowledge, ...] = ("free", "known")
POWER: tuple[PowerKnowledge, ...] = ("known", "unknown")
#: Fields that the page's sensor does not have, because readings and estimates do not depend on
#: them.
UNUSED = ("correction", "calibration", "thermal", "delays", "drift")
#: The properties of a sensor's parts that the page's functions use.
PROPERTIES = ("cut", "on", "has_profile")

MODEL = """\
const Model = (() => {{
{numbers}
{texts}

// The sensor as its configuration gives it; mm, rad, mW.
const NOMINAL = {sensor};
const SOLVER = {solver};
const RANGE = {range}, RIM_MM = {rim};
// The functions of an estimate, by the numbers of the unknowns after the pose.
const ESTIMATORS = {{{estimators}}};
// Readings with their derivatives by the state, of the kind with which the solver steps.
const linearise = {linearise};
// The same with nothing left out, for where steps stall; null where they leave out nothing.
const lineariseExactly = {exactly};

{light}
{noise}
{solving}
{ranging}
// The sensor at rest, as vectors, and what follows from it.
let sensor, geometry, solver, ranges;
const readings = (state) => sceneReadings(geometry, scene(geometry, state)).flat();
function change(given) {{
  sensor = given;
  geometry = vectors(sensor);
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
  // The bodies of the sensor in use, see light.js, and the height at which a sub-beam passes.
  bodies: () => Light.bodies(sensor, geometry),
  height: subBeamHeight,
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


#: The exact derivatives by the state, in the form of `gradient.linearise`; computed by columns.
EXACTLY = """(geometry, state) => {
  const at = scene(geometry, state);
  const units = state.map((_, n) => state.map((_, c) => (c === n ? 1 : 0)));
  const columns = units.map((unit) => exactSlopes(geometry, state, unit, at));
  return sceneReadings(geometry, at).map((values, k) =>
    [values, values.map((_, i) => columns.map((each) => each[k][i]))]);
}"""


def text_of(name: str) -> str:
    """Read a file of this folder."""
    return files(__package__).joinpath(name).read_text("utf-8")


def model(sensor: Sensor, rules: Rules | None = None) -> str:
    """Return JavaScript that defines `Model`: readings, drawing, poses and ranges of a sensor.

    rules: of the range; by default those of a configuration that states none.
    """
    text, data = TEXTS[sensor.apertures.cut, sensor.light.on], as_data(sensor)
    functions: dict[Any, str] = {}
    vectors = javascript("vectors", partial(vectors_of, sensor), functions, data)
    write_optics(text, vectors, functions)
    plans = {
        f'"{beam} {power}"': plan.make_plan(sensor, Knowledge(beam=beam, power=power))
        for beam, power in product(BEAM, POWER)
    }
    forms = [Form(tuple(each.free.tolist()), kind_of(sensor)) for each in plans.values()]
    has_steps = text is exact_text.BENCH
    exactly = "lineariseIdeal" if text is exact_text.IDEAL else EXACTLY
    linearise = "lineariseNearly" if has_steps else exactly
    estimators = [write_estimator(form, vectors, functions) for form in forms]
    return MODEL.format(
        numbers=text_of("numbers.js"),
        texts="\n\n".join(functions.values()),
        sensor=literal(data),
        solver=literal(solver_data(sensor, plans)),
        range=literal(range_data(sensor, rules or Rules())),
        rim=RIM_MM,
        ranging=text_of("range.js"),
        light=text_of("light.js"),
        noise=text_of("noise.js"),
        solving=text_of("solver.js"),
        estimators=", ".join(estimators),
        linearise=linearise,
        exactly=EXACTLY if has_steps else "null",
    )


def vectors_of(sensor: Sensor, data: Any) -> forward.Geometry:
    """The vectors of a sensor with the effects of light of `sensor` and the numbers of `data`.

    data: an object with the attributes of a sensor, from `as_data`.
    """
    numbers = arrays.light_numbers(sensor)
    light = LightEffects(numbers, arrays.options(data)) if sensor.light.on else None
    parameters = tuple(arrays.parameter_values(data))
    return forward.build_geometry(parameters, arrays.openings(data), light)


def write_optics(
    text: exact_text.ExactText, vectors: forward.Geometry, functions: dict[Any, str]
) -> None:
    """Add the functions of the optics to a page's functions.

    vectors: an example of the sensor's vectors.  functions: see `javascript.javascript`.
    """
    without_light = javascript("darkScene", forward.dark_scene, functions, vectors, STATE)
    javascript("apparentScene", curved_light.apparent_scene, functions, vectors, without_light)
    at = javascript("scene", text.scene, functions, vectors, STATE)
    javascript("sceneReadings", text.readings, functions, vectors, at)
    javascript("footprints", footprint.footprints, functions, vectors, STATE)
    javascript("lineariseIdeal", gradient.linearise, functions, vectors, STATE)
    if text is exact_text.BENCH:
        nearly = bench_gradient.linearise_nearly
        javascript("lineariseNearly", nearly, functions, vectors, STATE)
    if text is not exact_text.IDEAL:

        def slopes(vectors: Any, state: Any, unit: Any, at: Any) -> Any:
            return text.slopes(vectors, tuple(map(Dual, state, unit)), at)

        javascript("exactSlopes", slopes, functions, vectors, STATE, STATE, at)
    for name, (function, examples) in FUNCTIONS.items():
        javascript(name, function, functions, *examples)


def write_estimator(form: Form, vectors: forward.Geometry, functions: dict[Any, str]) -> str:
    """Add the functions of an estimate to a page's functions, and return their entry in ESTIMATORS.

    vectors, functions: as in `write_optics`.
    """
    name = "".join(map(str, form.free[6:]))

    def advance(state: Any, question: Any, vectors: Any, linearise: Any) -> Any:
        def optics(x: Any) -> Any:
            moved = forward.replace_power(vectors, x[8])
            return step.unknown_slopes(moved, linearise(x), form.free)

        return step.step(state, question, optics)

    def results(end: step.State) -> Any:
        return step.residual_of(end), step.covariance_of(end.factor, form.free)

    def begin(start: Any, status: Any) -> step.State:
        return step.first_state(start, form, status)

    question, _, _ = javascript(
        f"ask{name}", partial(step.screen_reading, form), functions, NINE, NINE, VECTOR, SCALES
    )
    state = javascript(f"begin{name}", begin, functions, NINE, NUMBER)
    javascript(f"step{name}", advance, functions, state, question, vectors, lambda: DETECTORS)
    javascript(f"results{name}", results, functions, state)
    parts = ", ".join(f"{part}: {part}{name}" for part in ("ask", "begin", "step", "results"))
    return f'"{name}": {{{parts}}}'


def as_data(value: Any) -> Any:
    """Convert a sensor or a part of it to dictionaries of its fields, in the code's units."""
    if isinstance(value, tuple):
        return tuple(map(as_data, value))
    if not is_dataclass(value):
        return float(value) if type(value) is int else value
    names = [field.name for field in fields(value) if field.name not in UNUSED]
    names += [name for name in PROPERTIES if hasattr(value, name)]
    return {name: as_data(getattr(value, name)) for name in names}


def solver_data(sensor: Sensor, plans: dict[str, plan.Plan]) -> dict[str, Any]:
    """The constants of an estimate that do not depend on the sensor's positions and sizes.

    plans: by what is known of beam and power.  limits: of the readings, as in
    `problem.ScreeningLimits`.  noise: see `electronic_noise`.  samples, fold: states at which the
    page looks for a fold, and its message then.  refusal: see `refusal`.
    """
    limits = plan.make_limits(sensor, False)
    return {
        "plans": {name: plan_data(sensor, each) for name, each in plans.items()},
        "limits": {"floor": limits.noise[2], "light": limits.light, "rounding": ROUNDING},
        "samples": doubts.unit_samples().round(9),
        "offset": doubts.OFFSET_FRACTION,
        "fold": FOLD,
        "noise": electronic_noise(sensor),
        "statuses": [status.label for status in Status if status < Status.SKIPPED],
        "refusal": refusal(sensor),
    }


def range_data(sensor: Sensor, rules: Rules) -> dict[str, Any]:
    """The constants of the range that do not depend on the sensor's positions and sizes."""
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
    """The light whose current is at the end of the amplifier's range when one electrode of a
    duo-lateral detector collects it all, mW; infinite without electronics."""
    electronics = sensor.electronics
    return (
        noise.largest_current(electronics) / (1e-3 * electronics.responsivity)
        if electronics
        else np.inf
    )


def range_refusal(sensor: Sensor) -> str:
    """The reason why the page cannot compute the range; empty if it can."""
    if not refusal(sensor):
        return ""
    return (
        "This page cannot compute the range, because it does not know the currents of these "
        "detectors; `facets range-map` does."
    )


def electronic_noise(sensor: Sensor) -> noise.TwoLayerNoise | None:
    """The noise of duo-lateral detectors' currents; None for other detectors."""
    electronics = sensor.electronics
    return (
        noise.two_layer_noise(electronics)
        if electronics and noise.has_two_layers(electronics)
        else None
    )


def plan_data(sensor: Sensor, todo: plan.Plan) -> dict[str, Any]:
    """The numbers of a plan of `estimation.plan`.

    means, weights, free: as in `Plan`.  none: `count_checks` without a detector.  limits: the
    largest residual, by the number of checks.
    """
    likely = plan.chance_of(sensor, todo)
    return {
        "means": todo.means[0],
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
    """The reason why the page cannot solve the readings of a sensor; empty if it can."""
    if sensor.electronics is not None and not noise.has_two_layers(sensor.electronics):
        return (
            f"This page knows the noise of duo-lateral detectors, not of {sensor.electronics.kind} "
            "ones, and so cannot weigh their readings; `facets solve` does."
        )
    return ""
