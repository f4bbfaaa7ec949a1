"""All that runs the text of the optics: what it computes, of which light, and how well.

`FLOATS` is Python's text. An execution that is replaced, or that comes new, changes `EXECUTIONS`
and nothing else: `tests/model/test_executions.py` compares each with floats.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any
from unittest.mock import patch

import as_text
import numpy as np
from digits import differences, many_digits, precise
from estimators import library, run_node, script
from facets.experiments.studies.sensors import skew_sensor
from sensors import ALL, ASYMMETRY, PROFILE, STAINS

import facets
from facets import BenchLight
from facets.model import (
    EFFECTS,
    arrays,
    blocks,
    effects,
    geometry_of,
    group_by_field,
    many,
    options,
    parameters,
    threads,
)
from facets.optics import OPEN, LightEffects, build_geometry
from facets.optics.footprint import footprints

APERTURES = facets.Apertures(beam=1.1, detectors=True, tip=0.03, rim=0.4, gap=0.01)
COATED = BenchLight(
    index=(1.37, 7.62), polarization=0.3, background=((5e-4, 1, 2), (4e-4, -1, 0.5), (6e-4, 0, -2))
)
#: What of a sensor makes each kind of light.
LIGHTS: dict[str, dict[str, Any]] = {
    "ideal": {},
    "bench": {"light": ALL},
    "profile": {"light": BenchLight(profile=PROFILE, asymmetry=ASYMMETRY, stains=STAINS)},
    "cut": {"apertures": APERTURES},
    "cut and coated": {"apertures": APERTURES, "light": COATED},
}
UNCUT = ("ideal", "bench", "profile")
#: Kinds of states: usual ones, turned far, with faint facets, and those that are none.
STATES = ("near", "turned", "far", "spoilt")
#: Of which all facets have light.
BRIGHT = ("near", "turned")
#: The functions of a sensor and of states (n, 8) that executions compute.
TASKS: dict[str, Callable[..., Any]] = {
    "readings": facets.readings,
    "jacobian": facets.jacobian,
    "state_jacobian": arrays.state_slopes,
    "approximate_jacobian": arrays.derivatives,
    "footprints": facets.footprints,
    "parameter_jacobian": facets.parameter_jacobian,
    "effect_jacobian": arrays.effect_jacobian,
}


@cache
def sensor_of(light: str, seed: int) -> facets.Sensor:
    """One of many sensors; the first is the paper's, the others have no symmetry."""
    return replace(skew_sensor(seed) if seed else facets.Sensor(), **LIGHTS[light])


#: Computes a task of `TASKS` for a sensor and states (n, 8).
Compute = Callable[[str, facets.Sensor, Any], Any]


@dataclass(frozen=True)
class Execution:
    """One way to run the optics' text.

    ulps: the largest difference from floats in units of the last place, by the task; these tasks
    are all that it has.  lights: of `LIGHTS`.  slow: those of them that take long.  reference: what
    it is compared with.  sensors, examples, rows: how many sensors, calls and states a test may
    ask for.  states: of `STATES`.  program: that it needs.
    """

    name: str
    compute: Compute
    ulps: Mapping[str, float]
    lights: tuple[str, ...] = UNCUT
    slow: tuple[str, ...] = ()
    reference: Compute | None = None
    sensors: int = 1000
    examples: int = 15
    rows: int = 10
    states: tuple[str, ...] = STATES
    program: str = ""


def machine_code(task: str, sensor: facets.Sensor, states: Any) -> Any:
    """What users call."""
    return TASKS[task](sensor, states)


def floats(task: str, sensor: facets.Sensor, states: Any) -> Any:
    """The text as it stands, in Python's floats; where these raise, in NumPy's, which do not."""
    geometry, rows = geometry_of(sensor), []
    for state in states:
        with np.errstate(all="ignore"):
            try:
                row = FLOATS[task](sensor, geometry, tuple(state.tolist()))
            except (ArithmeticError, ValueError):
                row = FLOATS[task](sensor, geometry, tuple(state))
        rows.append(row)
    return np.array(rows, float)


def parameter_slopes(sensor: facets.Sensor, geometry: Any, state: Any) -> Any:
    light = arrays.light_effects(sensor) if sensor.light.on else None
    varied = arrays.varying(parameters(sensor), range(30))
    moved = build_geometry(varied, arrays.openings(sensor), light)
    return as_text.slopes(moved, geometry, state)


def effect_slopes(sensor: facets.Sensor, geometry: Any, state: Any) -> Any:
    light = LightEffects(
        group_by_field(arrays.varying(effects(sensor), range(len(EFFECTS)))),
        options(sensor, profiled=True),
    )
    plain = LightEffects(group_by_field(effects(sensor).tolist()), light.options)
    moved, own = (build_geometry(parameters(sensor), OPEN, each) for each in (light, plain))
    return as_text.slopes(moved, own, state)


FLOATS: dict[str, Callable[..., Any]] = {
    "readings": lambda sensor, *at: as_text.readings(*at),
    "jacobian": lambda sensor, *at: as_text.derivatives(*at),
    "state_jacobian": lambda sensor, *at: as_text.derivatives(*at),
    "approximate_jacobian": lambda sensor, *at: as_text.approximate_derivatives(*at),
    "footprints": lambda sensor, *at: list(footprints(*at)),
    "parameter_jacobian": parameter_slopes,
    "effect_jacobian": effect_slopes,
}


def in_lanes(width: int, task: str, sensor: facets.Sensor, states: Any) -> Any:
    """The same as `machine_code`, in blocks of another width."""
    kernel, memory = blocks.kernel, partial(blocks.BlockMemory, width)
    with (
        patch.object(blocks, "lanes", lambda: width),
        patch.object(blocks, "kernel", lambda name, few=None: kernel(name, few or width)),
        patch.object(blocks, "slopes_kernel", partial(slopes_kernel, width)),
        patch.object(blocks, "RESTS", threads.Pool(memory)),
    ):
        return TASKS[task](sensor, states)


@cache
def slopes_kernel(width: int, name: str) -> Any:
    return blocks.load_code(name, 7, width)


def many_sensors(task: str, sensor: facets.Sensor, states: Any) -> Any:
    """Each state with a sensor of its own, of which every second is another one."""
    both = [parameters(each) for each in (sensor, sensor_of("ideal", 7))]
    owner = np.repeat(np.arange(2), len(states))
    name = {"jacobian": "derivatives"}.get(task, task)
    vectors = many.vectors_of(np.array(both))
    return many.evaluate(name, vectors, owner, np.concatenate([states, states]))[: len(states)]


def precise_readings(sensor: facets.Sensor, given: Any, light: Any, state: Any) -> Any:
    """Nine readings of numbers of any type: 30 parameters, 81 of the light, 8 of a state."""
    effect = LightEffects(group_by_field(light), options(sensor, profiled=True))
    openings = arrays.openings(sensor)
    vectors = build_geometry(tuple(given), openings, effect if sensor.light.on else None)
    return np.array(as_text.readings(vectors, tuple(state)))


def forty_digits(task: str, sensor: facets.Sensor, states: Any) -> Any:
    """Readings, and derivatives by differences."""
    results = []
    with many_digits():
        given, light = precise(parameters(sensor)), precise(effects(sensor))
        for state in states:
            at = precise(state)
            by_task = {
                "readings": lambda at=at: precise_readings(sensor, given, light, at),
                "jacobian": lambda at=at: differences(
                    at, lambda moved: precise_readings(sensor, given, light, moved)
                ),
                "parameter_jacobian": lambda at=at: differences(
                    given, lambda moved: precise_readings(sensor, moved, light, at)
                ),
                "effect_jacobian": lambda at=at: differences(
                    light, lambda moved: precise_readings(sensor, given, moved, at)
                ),
            }
            try:
                result = by_task[task]().astype(float)
            except ZeroDivisionError:  # a facet's power is below what 40 digits hold
                (result,) = floats(task, sensor, state[None])
                assert not (result[2::3] > 1e-25).all()
            if task == "readings":  # Light of 1e-41 mW is rounding noise here, but not of floats.
                faint = np.repeat(np.abs(result[2::3]) < 1e-25, 3)
                result[faint] = floats(task, sensor, state[None])[0][faint]
            results.append(result)
    return np.array(results)


def exported_c(precision: str, task: str, sensor: facets.Sensor, states: Any) -> Any:
    return library(sensor, precision).readings(states)


def ask_page(expression: str, model: str) -> Any:
    """What an expression of JavaScript gives in which `Model` is a page's model."""
    return json.loads(run_node(f"{model}\nconsole.log(JSON.stringify({expression}))", ""))


def as_script(array: Any) -> str:
    """An array of numbers as JavaScript, with those that are not finite."""
    text = json.dumps([[repr(value) for value in row] for row in np.asarray(array).tolist()])
    return f"{text.replace('nan', 'NaN').replace('inf', 'Infinity')}.map((row) => row.map(Number))"


def javascript(task: str, sensor: facets.Sensor, states: Any) -> Any:
    readings = f"{as_script(states)}.map((state) => Model.readings(state).map(String))"
    return np.array(ask_page(readings, script(sensor)), float)


BENCH = ("bench", "profile")
SINGLE, DOUBLE = "-DFACETS_FLOAT", "-DFACETS_DOUBLE"
#: Derivatives by parameters are sums of terms that cancel.
SLOPES = {"jacobian": 1e3, "parameter_jacobian": 1e5}
BENCH_SLOPES = {"jacobian": 1e5, "parameter_jacobian": 1e7, "effect_jacobian": 1e7}
CUT_SLOPES = {"jacobian": 1e6, "parameter_jacobian": 1e6}
BITS = {"readings": 0, "jacobian": 0, "footprints": 0}
IDEAL = ("readings", "jacobian", "footprints", "parameter_jacobian")
EXECUTIONS = [
    Execution("machine code", machine_code, {"readings": 4, "footprints": 50, **SLOPES},
              ("ideal",)),
    # What 40 digits are from floats, floats may be from other floats.
    Execution("machine code of a bench", machine_code,
              {"readings": 8, "footprints": 50}, BENCH, BENCH),
    # Of a facet with hardly any light, derivatives by the edges' effects cancel.
    Execution("derivatives of a bench", machine_code,
              {"approximate_jacobian": 1e3, "state_jacobian": 1e5, **BENCH_SLOPES},
              BENCH, BENCH, states=BRIGHT),
    Execution("2 lanes", partial(in_lanes, 2), BITS, slow=BENCH, reference=machine_code),
    Execution("4 lanes", partial(in_lanes, 4), BITS, slow=BENCH, reference=machine_code),
    Execution("8 lanes", partial(in_lanes, 8), BITS, slow=BENCH, reference=machine_code),
    Execution("many sensors", many_sensors, BITS, ("ideal",), reference=machine_code),
    Execution("cut light", machine_code, {"readings": 200, **CUT_SLOPES}, ("cut",)),
    Execution("cut light on coatings", machine_code, {"readings": 200, "jacobian": 1e6},
              ("cut and coated",), ("cut and coated",)),
    Execution("C in double precision", partial(exported_c, DOUBLE),
              {"readings": 4}, ("ideal",),
              sensors=2, program="gcc"),
    # Where one facet's light is no number, C knows which of its products with zero to leave out.
    Execution("C of real light", partial(exported_c, DOUBLE), {"readings": 8}, BENCH, BENCH,
              sensors=2, states=BRIGHT, program="gcc"),
    Execution("C of cut light", partial(exported_c, DOUBLE), {"readings": 200},
              ("cut", "cut and coated"), ("cut", "cut and coated"), sensors=2, program="gcc"),
    Execution("C in single precision", partial(exported_c, SINGLE),
              {"readings": 1e10}, ("ideal",),
              sensors=2, states=BRIGHT, program="gcc"),
    Execution("JavaScript", javascript, {"readings": 4}, ("ideal",), examples=2, rows=40,
              program="node"),
    Execution("JavaScript of a bench", javascript, {"readings": 8}, BENCH, examples=2, rows=40,
              program="node"),
    Execution("JavaScript of cut light", javascript, {"readings": 200}, ("cut", "cut and coated"),
              examples=2, rows=40, program="node"),
    # Powers of spoilt states are below what 40 digits hold.
    Execution("40 digits", forty_digits, {"readings": 4}, ("ideal",), examples=8, rows=3,
              states=("near", "turned", "far")),
    Execution("40 digits of a bench", forty_digits, {"readings": 8}, BENCH, examples=6, rows=3,
              states=BRIGHT),
    Execution("differences at 40 digits", forty_digits,
              {"jacobian": 1e2, "parameter_jacobian": 1e4}, ("ideal",), examples=2, rows=1,
              states=BRIGHT),
    Execution("differences at 40 digits of cut light", forty_digits,
              CUT_SLOPES, ("cut", "cut and coated"), ("cut and coated",), examples=2, rows=1,
              states=BRIGHT),
    Execution("differences at 40 digits of a bench", forty_digits, BENCH_SLOPES, BENCH, BENCH,
              examples=2, rows=1, states=BRIGHT),
]  # fmt: skip
