"""A layout's variables, and the outcome of layouts at states, by the float model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..characterization.ranges import fine_slopes
from ..core.errors import InputError
from ..core.names import DETECTORS, FINE_UNITS
from ..core.rigid_body import MeasuredObject
from ..core.sensor import Sensor
from ..core.units import Floats
from ..detectors.noise import electrode_currents, largest_current, standard_deviations
from ..model.arrays import half_sizes, parameters, sensor_with
from ..model.many import evaluate
from ..model.packing import pack_rows
from ..optics.forward import Geometry, Scene, build_geometry, dark_scene, sub_beam_height
from ..scalars.nesting import leaves

if TYPE_CHECKING:
    from ..core.layout import Layout

#: Where the parts of a sensor's 30 parameters begin: the beam, the facets, the detectors.
FACETS, PSDS = (6, 8, 10), (12, 18, 24)


class Outcome(NamedTuple):
    """The model's results for k layouts at m states, arrays (k, m).

    variances: 6, um^2 and urad^2.  powers: 3, mW.  condition: square of the weighted Jacobian's
    condition number in the Frobenius norm, which is 1 to 8 times that in the spectral norm.
    headrooms: the unused fraction of the full scale of each of twelve amplifiers; empty unless the
    noise follows from electronics.
    """

    variances: list[Floats]
    powers: list[Floats]
    condition: Floats
    headrooms: list[Floats]


class LayoutValues(NamedTuple):
    """Layouts evaluated at states: the model's vectors and scene, the detectors' sizes, mm, the
    results, and the heads' diameters, mm."""

    fixed: Geometry
    at: Scene
    sizes: list[Any]
    outcome: Outcome
    heads: list[Any]


def evaluate_layouts(
    sensor: Sensor,
    names: Sequence[str],
    x: Any,
    state: tuple[Any, ...],
    body: MeasuredObject | None,
) -> LayoutValues:
    """Evaluate k layouts at m states.

    x: the variables' values, columns (k, 1).  state: from `columns_of_states`.  body: the object
    to whose displacement the variances belong.
    """
    parameters, sizes = layout_parameters(sensor, names, x)
    fixed = build_geometry(tuple(parameters))
    outcome = outcome_of(sensor, fixed, sizes, state, gain_of(sensor, names, x), body)
    heads = [2 * parameters[psd] for psd in PSDS]
    return LayoutValues(fixed, dark_scene(fixed, state), sizes, outcome, heads)


def values_between(variables: Mapping[str, tuple[float, float]], fractions: Floats) -> list[Floats]:
    """The variables' values, columns (k, 1), from fractions (k, n or more) of the way between their
    bounds."""
    low, high = np.array(list(variables.values())).T
    return list((low + (high - low) * fractions[:, : len(variables)]).T[:, :, None])


#: Fraction of an amplifier's full scale that a design's light may use; the remainder is for the
#: laser's noise, the parts' tolerances, and the noise of the reading.
FULL = 0.95


def columns_of_states(states: Floats) -> tuple[Any, ...]:
    """Split states (m, 8) or (k, m, 8) into the eight numbers that `outcome_of` takes."""
    return tuple(np.ascontiguousarray(states[..., i]) for i in range(8))


def outcome_of(
    sensor: Sensor,
    fixed: Geometry,
    sizes: Sequence[Any],
    state: Sequence[Any],
    gain: Any = None,
    body: MeasuredObject | None = None,
) -> Outcome:
    """Compute the results for k layouts at m states.

    fixed: vectors of floats or columns (k, 1).  sizes: sides of the square detectors, mm, likewise.
    state: eight arrays, each (m,) or (k, m), from `columns_of_states`.  gain: of the amplifiers,
    ohm; None for the sensor's.  body: the object to whose displacement the variances belong.
    """
    rows = [len(each) for each in state if each.ndim == 2]
    count = max(1, *(getattr(each, "size", 1) for each in (*leaves(fixed), *sizes, gain)), *rows)
    states = np.empty((count, np.shape(state[0])[-1], 8))
    for i, values in enumerate(state):
        states[..., i] = values
    shape, owner = states.shape[:2], np.repeat(np.arange(count), states.shape[1])
    vectors, states = pack_rows(fixed, count), states.reshape(-1, 8)
    reading = evaluate("readings", vectors, owner, states)
    matrices = evaluate("derivatives", vectors, owner, states)
    sigma, headrooms = noise_of(sensor, reading.reshape(*shape, 9), sizes, gain)
    scaled = matrices * np.array(FINE_UNITS) / sigma.reshape(-1, 9)[:, :, None]
    variances, condition = spectrum_of(scaled, fine_slopes(states, body))
    powers = reading[:, 2::3].reshape(*shape, 3)
    return Outcome(
        list(np.moveaxis(variances.reshape(*shape, 6), -1, 0)),
        list(np.moveaxis(powers, -1, 0)), condition.reshape(shape), headrooms,
    )  # fmt: skip


def spectrum_of(matrices: Floats, slopes: Floats | None = None) -> tuple[Floats, Floats]:
    """The variances of the pose (n, 6) and `Outcome.condition` (n,) of Jacobians (n, 9, 8).

    slopes: (n, 6, 6) from `fine_slopes`, for the variances of an object's pose.
    """
    triangle = np.asarray(np.linalg.qr(matrices, mode="r")).transpose(1, 2, 0).copy()
    inverse = np.zeros_like(triangle)  # row by row from the last, of all matrices at once
    with np.errstate(divide="ignore", invalid="ignore"):
        for i in reversed(range(len(triangle))):
            inverse[i, i] = 1 / triangle[i, i]
            products = (triangle[i, i + 1 :, None] * inverse[i + 1 :, i + 1 :]).sum(axis=0)
            inverse[i, i + 1 :] = -products * inverse[i, i]
    squares = (inverse**2).sum(axis=1)
    variances = squares[:6].T
    if slopes is not None:
        variances = ((slopes @ inverse[:6].transpose(2, 0, 1)) ** 2).sum(axis=2)
    return variances, (matrices**2).sum(axis=(1, 2)) * squares.sum(axis=0)


def noise_of(
    sensor: Sensor, reading: Floats, sizes: Sequence[Any], gain: Any
) -> tuple[Floats, list[Any]]:
    """Standard deviations of readings (k, m, 9), and for each of the twelve amplifiers, if any, the
    unused fraction (k, m) of its full scale."""
    if sensor.electronics is None:
        return standard_deviations(sensor, reading), []
    parts = []
    for n, built in enumerate(electronics_of(sensor, sizes, gain, len(reading))):
        electronics = built.electronics
        assert electronics is not None
        full = FULL * largest_current(electronics)
        light = reading[n].reshape(-1, 3, 3)
        currents = electrode_currents(electronics, half_sizes(built), light)
        headroom_left = 1 - currents.reshape(-1, 12) / full
        parts.append((standard_deviations(built, reading[n]), headroom_left))
    sigma, headroom = (np.stack(part) for part in zip(*parts, strict=True))
    return sigma, list(np.moveaxis(headroom, -1, 0))


def electronics_of(
    sensor: Sensor, sizes: Sequence[Any], gain: Any, count: int
) -> Iterator[Sensor]:  # fmt: skip
    """Yield the sensor with each layout's amplifiers and detector sizes."""
    is_fixed = all(isinstance(size, float) for size in sizes)
    for n in range(count):
        built = sensor
        if gain is not None and not isinstance(gain, float):
            assert sensor.electronics is not None
            electronics = replace(sensor.electronics, transimpedance=gain[n].item())
            built = replace(built, electronics=electronics)
        if not is_fixed:
            sides = [float(np.broadcast_to(size, (count, 1))[n, 0]) for size in sizes]
            a, b, c = (
                replace(psd, size_y=side, size_z=side)
                for psd, side in zip(sensor.psds, sides, strict=True)
            )
            built = replace(built, psds=(a, b, c))
        yield built


UNITS = {"mm": 1.0, "mw": 1.0, "mrad": 1e-3, "deg": np.pi / 180, "kohm": 1e3}
#: The amplifiers' gain, the only variable that is no parameter of the optics or a size.
GAIN = "transimpedance_kohm"
#: Positions of the variables among the parameters of one facet or detector.
OF_A_FACET = {"inclination_deg": 0, "azimuth_deg": 1}
OF_A_PSD = {"radius_mm": 0, "azimuth_deg": 1, "height_mm": 2,
            "roll_mrad": 3, "pitch_mrad": 4, "yaw_mrad": 5}  # fmt: skip


def require_variables(layout: Layout, name: str = "the layout") -> None:
    """Raise `InputError` if no variable may vary.  name: of the layout's configuration."""
    if not layout.variables:
        raise InputError(
            f"optimize.variables of {name} is empty; state what may vary in a file of your own, "
            "such as one with the lines `extends: paper` and "
            "`optimize: {variables: {radius_mm: [150, 260]}}`"
        )


def unit_of(name: str) -> float:
    """The unit with which a variable's name ends, in mm, mW, rad or ohm."""
    return UNITS[name.rpartition("_")[2]]


#: Positions among the 30 parameters of the variables that belong to a single facet or detector.
SINGLES = {
    f"{kind}_{letter}_{key}": first[k] + i
    for kind, first, keys in (("facet", FACETS, OF_A_FACET), ("psd", PSDS, OF_A_PSD))
    for k, letter in enumerate(DETECTORS)
    for key, i in keys.items()
}


def present_values(sensor: Sensor) -> dict[str, float]:
    """The values that the variables have in a sensor, in the units of their names."""
    psd, p = sensor.psds[0], parameters(sensor)
    values = {
        "radius_mm": psd.radius,
        "inclination_deg": sensor.facets[0].inclination,
        "roll_mrad": psd.roll,
        "pitch_mrad": psd.pitch,
        "yaw_mrad": psd.yaw,
        "azimuth_b_deg": sensor.facets[1].azimuth,
        "size_mm": min(psd.size_y, psd.size_z),
        "diameter_mm": sensor.beam.diameter_x,
        "power_mw": sensor.beam.power,
        GAIN: sensor.electronics.transimpedance if sensor.electronics else np.nan,
    } | {name: float(p[i]) for name, i in SINGLES.items()}
    return {name: value / unit_of(name) for name, value in values.items()}


def layout_parameters(sensor: Sensor, names: Sequence[str], x: Any) -> tuple[list[Any], list[Any]]:
    """The 30 parameters and the 3 sizes if the named variables have the values x.

    x: floats or arrays, in the units of the names. If an inclination varies, the detectors' heights
    follow the sub-beams.
    """
    value = {name: x[i] * unit_of(name) for i, name in enumerate(names)}
    changed = common_parameters(value) | {i: value[n] for n, i in SINGLES.items() if n in value}
    present = parameters(sensor)
    for facet, psd in zip(FACETS, PSDS, strict=True):
        if facet in changed and psd + 2 not in changed:
            changed[psd + 2] = sub_beam_height(changed.get(psd, present[psd]), changed[facet])
    sizes = [value.get("size_mm", min(psd.size_y, psd.size_z)) for psd in sensor.psds]
    return [changed.get(i, number) for i, number in enumerate(present)], sizes


def common_parameters(value: dict[str, Any]) -> dict[int, Any]:
    """The parameters that the common variables set, by their numbers.

    value: the variables' values by name, in mm, mW and rad.
    """
    places = {
        "power_mw": (0,),
        "diameter_mm": (1, 2),
        "inclination_deg": FACETS,
        **{name: [psd + i for psd in PSDS] for name, i in OF_A_PSD.items()},
    }
    by_place = {i: value[name] for name, each in places.items() if name in value for i in each}
    if "azimuth_b_deg" in value:
        for k, turn in ((1, value["azimuth_b_deg"]), (2, 2 * np.pi - value["azimuth_b_deg"])):
            by_place |= {FACETS[k] + 1: turn, PSDS[k] + 1: turn}
    return by_place


def sensor_of(sensor: Sensor, names: Sequence[str], x: Floats) -> Sensor:
    """The sensor with the named variables at x. Raises `InputError` for an invalid sensor."""
    p, sizes = layout_parameters(sensor, names, x.tolist())
    made = sensor_with(sensor, p)
    if GAIN in names and made.electronics is not None:
        gain = gain_of(sensor, names, x.tolist())
        made = replace(made, electronics=replace(made.electronics, transimpedance=gain))
    if "size_mm" not in names:
        return made
    a, b, c = (replace(psd, size_y=d, size_z=d) for psd, d in zip(made.psds, sizes, strict=True))
    return replace(made, psds=(a, b, c))


def gain_of(sensor: Sensor, names: Sequence[str], x: Any) -> Any:
    """The amplifiers' gain, ohm, if the named variables have the values x; None if the noise does
    not follow from electronics."""
    if sensor.electronics is None:
        return None
    if GAIN not in names:
        return sensor.electronics.transimpedance
    return x[list(names).index(GAIN)] * unit_of(GAIN)
