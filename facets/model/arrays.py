"""The sensor's model on arrays: readings, their derivatives, and which spots reach a detector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.arguments import as_floats, check_arguments
from ..core.errors import InputError
from ..core.sensor import EFFECTS as EFFECTS, LIGHT_EFFECTS, Sensor
from ..core.units import Floats
from ..optics.effects import UNBOUNDED, LightEffects, LightOptions
from ..optics.forward import BEAM, FACET, PSD, Geometry, Openings, build_geometry
from ..scalars.dual import Dual
from ..scalars.nesting import leaves, nest
from . import blocks, packing
from .kinds import ANY_LIGHT, LIT, kind_of
from .threads import share


def parameters(sensor: Sensor) -> tuple[float, ...]:
    """The sensor's 30 parameters in the order of `facets.PARAMETERS`; mm, rad, mW."""
    return tuple(map(float, parameter_values(sensor)))


def parameter_values(sensor: Any) -> list[Any]:
    """The 30 parameters without conversion, of a sensor or of an object with the same
    attributes."""
    values = [getattr(sensor.beam, name) for name in BEAM]
    for facet in sensor.facets:
        values += [getattr(facet, name) for name in FACET]
    for psd in sensor.psds:
        values += [getattr(psd, name) for name in PSD]
    return values


def sensor_with(sensor: Sensor, p: Sequence[float]) -> Sensor:
    """The sensor with other values of its 30 parameters.

    Raises `InputError` if a value is not allowed.
    """
    values = iter(p)
    beam = replace(sensor.beam, **{name: next(values) for name in BEAM})
    a, b, c = (replace(part, **{name: next(values) for name in FACET}) for part in sensor.facets)
    placements: list[Any] = [{name: next(values) for name in PSD} for _ in sensor.psds]
    d, e, f = (replace(part, **new) for part, new in zip(sensor.psds, placements, strict=True))
    return replace(sensor, beam=beam, facets=(a, b, c), psds=(d, e, f))


def geometry_of(sensor: Sensor) -> Geometry:
    """The sensor's vectors, in plain floats."""
    light = light_effects(sensor) if sensor.light.on else None
    return build_geometry(parameters(sensor), openings(sensor), light)


#: Distance to the edge of a detector, mm, below which the loss by diffraction is constant.
MIN_EDGE_DISTANCE_MM = 0.1


def options(sensor: Sensor, profiled: bool = False) -> LightOptions:
    """The options of the light that do not vary, whether or not any effect is on.

    profiled: whether derivatives by the beam's profile or by stains are needed, even if these are
    zero.
    """
    light = sensor.light
    return LightOptions(
        True,
        light.index is not None,
        light.polarization is not None,
        profiled or light.has_profile,
        detector_halves(sensor),
        MIN_EDGE_DISTANCE_MM,
    )


def detector_halves(sensor: Sensor) -> Any:
    """`half_sizes` as plain floats."""
    return tuple((psd.size_y / 2, psd.size_z / 2) for psd in sensor.psds)


def light_effects(sensor: Sensor, profiled: bool = False) -> LightEffects:
    """The numbers and options of real light for `build_geometry`.  profiled: as in `options`."""
    return LightEffects(light_numbers(sensor), options(sensor, profiled))


def light_numbers(sensor: Sensor) -> dict[str, Any]:
    """The numbers of the bench's light, by the fields of `BenchLight`."""
    return group_by_field(effects(sensor).tolist())


def group_by_field(values: Sequence[Any]) -> dict[str, Any]:
    """Group numbers in the order of `EFFECTS` by the fields of `BenchLight`, as tuples."""
    each = iter(values)
    return {
        field: tuple(next(each) for _ in effect.names) for field, effect in LIGHT_EFFECTS.items()
    }


def effects(sensor: Sensor) -> Floats:
    """The numbers of the bench's light in the order of `EFFECTS`: (81,) 1/mm, mm, mm^2, mW, rad.

    The index of a coating that reflects all is 1 + 0i; the polarisation of unpolarised light is 0.
    """
    numbers: list[float] = []
    for field, effect in LIGHT_EFFECTS.items():
        value = getattr(sensor.light, field)
        numbers += effect.absent if value is None else leaves(value)
    return np.array(numbers)


def replace_effects(sensor: Sensor, values: Sequence[float] | Floats) -> Sensor:
    """Return the sensor with other numbers of its light, in the order of `EFFECTS`.

    An ideal coating and unpolarised light stay so. Raises `InputError` for an impossible number.
    """
    if len(values) != len(EFFECTS):
        raise InputError(f"{len(values)} numbers of the light; needed: {len(EFFECTS)}")
    fields = dict[str, Any]()
    for field, numbers in group_by_field([float(value) for value in values]).items():
        old = getattr(sensor.light, field)
        fields[field] = None if old is None else nest(old, iter(numbers))
    return replace(sensor, light=replace(sensor.light, **fields))


def varying(values: Sequence[float] | Floats, which: Sequence[int]) -> Any:
    """Numbers, some of which carry derivatives (len(which),) with respect to themselves.  which:
    their places."""
    numbers: list[Any] = [float(value) for value in values]
    for n, seed in zip(which, np.eye(len(which)), strict=True):
        numbers[n] = Dual(numbers[n], seed)
    return tuple(numbers)


#: Imaginary step whose square underflows, so that the imaginary part of a result is a derivative.
STEP = 1e-100


def varying_by_steps(values: Sequence[float], which: Sequence[int]) -> Any:
    """The numbers of `varying` as complex columns, for formulas without arc tangents; takes a third
    of the time."""
    numbers: list[Any] = list(values)
    for n, step in zip(which, np.eye(len(which)) * (STEP * 1j), strict=True):
        numbers[n] = numbers[n] + step
    return tuple(numbers)


#: Message for light that is cut: its model includes coating and background, but not their
#: derivatives.
CUT_LIGHT = (
    "derivatives by a sensor's parameters are not known where sensor.apertures cut the light and "
    "sensor.light has effects; leave one of the two out to calibrate, or to use a calibration"
)


def effect_jacobian(sensor: Sensor, state: ArrayLike, names: Sequence[str] | None = None) -> Floats:
    """The derivatives of the readings by the numbers of the bench's light, closed.

    state: (..., 8). Returns (..., 9, 81), columns in the order of `EFFECTS`; mm and mW per unit of
    each number, also for ideal light.  names: the columns to compute; the others are zero. The
    derivatives by the index of an ideal coating and by the polarisation of
    unpolarised light are zero. NaN as in `jacobian`. Raises `InputError` for a sensor with
    apertures.
    """
    rows, shape = as_rows(state, 8, "state")
    if sensor.apertures.cut:
        raise InputError(CUT_LIGHT)
    columns = [n for n, name in enumerate(EFFECTS) if names is None or name in names]
    out = np.zeros((len(rows), 9, len(EFFECTS)))
    if columns:
        profiled = any(EFFECTS[n].startswith(("profile.", "asymmetry.", "stain_")) for n in columns)
        plain = light_effects(sensor, profiled)
        varied = plain._replace(numbers=group_by_field(varying(effects(sensor), columns)))
        vectors, moved = (
            build_geometry(parameters(sensor), openings(sensor), light) for light in (plain, varied)
        )
        slopes = packing.pack_slopes(moved, len(columns))
        out[:, :, columns] = slopes_at(ANY_LIGHT, packing.pack(vectors), slopes, rows)
    return out.reshape(*shape, 9, len(EFFECTS))


def slopes_at(kind: str, packed: Floats, varied: Floats, states: Floats) -> Floats:
    """The derivatives of the readings at states (n, 8) by m variables, for uncut light: (n, 9, m).

    kind: of light.  packed, varied: as `blocks.slopes` takes them.
    """
    derivatives = np.empty((len(states), 9, len(varied)))
    if len(states):
        rows = np.ascontiguousarray(states)
        blocks.slopes(f"slopes_of_{kind}", packed, varied, rows, derivatives)
    return derivatives


def openings(sensor: Sensor) -> Openings:
    """The sensor's apertures for `build_geometry`."""
    apertures = sensor.apertures
    halves = detector_halves(sensor) if apertures.detectors else (UNBOUNDED, UNBOUNDED, UNBOUNDED)
    return Openings(
        apertures.cut, 2 * apertures.beam, apertures.tip, apertures.rim, apertures.gap, halves
    )


def packed_vectors(sensor: Sensor) -> Floats:
    """The sensor's vectors as one array (numbers,) for the kernels, made once per sensor and
    process."""
    packed: Floats | None = sensor.__dict__.get("_packed")
    if packed is None:
        packed = sensor.__dict__["_packed"] = packing.pack(geometry_of(sensor))
    return packed


def parameter_slopes(sensor: Sensor, states: Floats, which: Sequence[int]) -> Floats:
    """The derivatives of the readings at states (n, 8) by some of the parameters: (n, 9, m)."""
    numbers, packed = parameters(sensor), packed_vectors(sensor)
    if sensor.light.on:
        moved = build_geometry(varying(numbers, which), openings(sensor), light_effects(sensor))
        return slopes_at(ANY_LIGHT, packed, packing.pack_slopes(moved, len(which)), states)
    moved = build_geometry(varying_by_steps(numbers, which))
    slopes = packing.pack_slopes(moved, len(which)) / STEP
    return slopes_at(kind_of(sensor), packed, slopes, states)


def state_slopes(sensor: Sensor, states: Floats) -> Floats:
    """The Jacobian at states (n, 8), for callers who also need `parameter_slopes`.

    Under real light it uses the same code, because compiling other code takes longer than that
    code saves.
    """
    if kind_of(sensor) not in LIT:
        return jacobian(sensor, states)
    slopes = np.eye(8, packing.PACKED + 8, packing.PACKED)
    return slopes_at(ANY_LIGHT, packed_vectors(sensor), slopes, states)


def as_vectors(values: ArrayLike, width: int, what: str) -> Floats:
    """Convert numbers to an (..., width) array; columns with names are found by these. Raises
    `InputError` for another shape."""
    array = as_floats(values, what, width)
    if array.shape[-1:] != (width,):
        raise InputError(f"{what} has shape {array.shape}; needed: (..., {width})")
    return array


def as_rows(values: ArrayLike, width: int, what: str) -> tuple[Floats, tuple[int, ...]]:
    """Convert an (..., width) array to (n, width) rows, and return the leading shape."""
    array = as_vectors(values, width, what)
    return np.ascontiguousarray(array).reshape(-1, width), array.shape[:-1]


@check_arguments
def readings(
    sensor: Sensor,
    state: ArrayLike,
    irradiance: Literal["exact", "paper"] = "exact",
    threads: int = 1,
) -> Floats:
    """Compute the detectors' readings, exact for collimated light and flat facets.

    Parameters
    ----------
    sensor
        The sensor.
    state
        States tx, ty, tz, roll, pitch, yaw, bx, by, (..., 8); mm and rad, world frame.
    irradiance
        "paper" evaluates Eqs. (7) to (9) as printed, for comparison. Eq. (8) omits a cross term and
        is exact only for a level sub-beam. Slow.
    threads
        Number of threads that share the states; 0 for all cores.

    Returns
    -------
    ndarray
        (..., 9): psi, zeta (mm, detector frame) and power (mW) of A, B and C. psi and zeta are the
        place of the spot's centroid on the detector's plane, also past its edge (see `reaches`).
        NaN for a detector whose facet is turned past the beam or whose plane its sub-beam never
        meets, and where the state is not finite.

    Notes
    -----
    The function of Eq. (1) of the paper.

    Examples
    --------
    >>> import facets
    >>> psi, zeta, power = facets.readings(facets.Sensor(), [0, 0, 0.5, 0, 0, 0.002, 0, 0])[:3]
    >>> f"psi {psi:.3f} mm, zeta {zeta:.3f} mm, {power:.3f} mW"
    'psi 0.500 mm, zeta 0.280 mm, 0.100 mW'
    """
    if irradiance == "exact":
        single = evaluate_one(sensor, "readings", state, threads)
        if single is not None:
            return single
    rows, shape = as_rows(state, 8, "state")
    if irradiance == "paper":
        from ..optics.paper import paper_readings

        if sensor.light.on:
            raise InputError(
                "the paper's irradiance is that of ideal light; leave sensor.light out to compare"
            )
        return paper_readings(geometry_of(sensor), rows).reshape(*shape, 9)
    return evaluate(sensor, "readings", rows, threads).reshape(*shape, 9)


def kernel_name(sensor: Sensor, name: str) -> str:
    """Return the name in `blocks.kernel` of results of a sensor: readings, derivatives, ..."""
    kind = kind_of(sensor)
    if name == "footprints":
        return "footprints_of_light" if sensor.light.on else name
    if kind in LIT:
        return f"{name}_of_{kind}"
    name = name.removeprefix("approximate_")
    return name if kind == "plain" else f"{name}_of_{kind}"


def evaluate_one(sensor: Sensor, name: str, state: ArrayLike, threads: int) -> Floats | None:
    """Evaluate a single state (8,), for loops that need one state at a time.

    Returns None for other states.
    """
    array = as_floats(state, "state", 8)
    if array.shape != (8,) or threads < 0:
        return None
    return blocks.run_one(kernel_name(sensor, name), packed_vectors(sensor), array)


def evaluate(sensor: Sensor, name: str, states: Floats, threads: int) -> Floats:
    """Evaluate the model at states (n, 8).  name: of the results (n, ...), see `kernel_name`."""
    vectors, kernel = packed_vectors(sensor), kernel_name(sensor, name)
    out = np.empty((len(states), *blocks.SHAPES[name.removeprefix("approximate_")]))
    blocks.kernel(kernel)  # compile before threads need the kernel
    share(lambda part: blocks.run(kernel, vectors, states[part], out[part]), len(states), threads)
    return out


@check_arguments
def jacobian(sensor: Sensor, state: ArrayLike, threads: int = 1) -> Floats:
    """Compute the derivatives of the readings by the state, in closed form.

    Parameters
    ----------
    sensor
        The sensor.
    state
        States tx, ty, tz, roll, pitch, yaw, bx, by, (..., 8); mm and rad, world frame.
    threads
        Number of threads that share the states; 0 for all cores.

    Returns
    -------
    ndarray
        (..., 9, 8): mm and mW per mm and rad. NaN in the rows of a detector for which `readings`
        gives NaN.

    Notes
    -----
    The derivative of Eq. (2); its determinant without one row is that of Eq. (11).

    Examples
    --------
    >>> import numpy as np, facets
    >>> slopes = facets.jacobian(facets.Sensor(), np.zeros(8))
    >>> f"psi_a moves {slopes[0, 5]:.0f} mm per rad of yaw"
    'psi_a moves 250 mm per rad of yaw'
    """
    if (single := evaluate_one(sensor, "derivatives", state, threads)) is not None:
        return single
    rows, shape = as_rows(state, 8, "state")
    return evaluate(sensor, "derivatives", rows, threads).reshape(*shape, 9, 8)


def derivatives(sensor: Sensor, states: Floats) -> Floats:
    """The Jacobian (n, 9, 8) at states (n, 8); under real light the Jacobian of
    `bench_gradient.linearise_nearly`."""
    return evaluate(sensor, "approximate_derivatives", states, threads=1)


@check_arguments
def parameter_jacobian(sensor: Sensor, state: ArrayLike) -> Floats:
    """Compute the derivatives of the readings by the sensor's parameters, in closed form.

    Parameters
    ----------
    sensor
        The sensor.
    state
        States tx, ty, tz, roll, pitch, yaw, bx, by, (..., 8); mm and rad, world frame.

    Returns
    -------
    ndarray
        (..., 9, 30), columns in the order of `facets.PARAMETERS`; mm and mW per mm, rad and mW.
        NaN as from `jacobian`.

    Examples
    --------
    >>> import numpy as np, facets
    >>> slopes = facets.parameter_jacobian(facets.Sensor(), np.zeros(8))
    >>> f"{slopes[2, facets.PARAMETERS.index('beam.power')]:.3f}"  # of the power on A
    '0.333'
    """
    rows, shape = as_rows(state, 8, "state")
    if sensor.light.on and sensor.apertures.cut:
        raise InputError(CUT_LIGHT)
    return parameter_slopes(sensor, rows, range(30)).reshape(*shape, 9, 30)


def half_sizes(sensor: Sensor) -> Floats:
    """Half sizes of the detectors' sensitive areas along y and z: (3, 2)."""
    return np.array(detector_halves(sensor))


def spot_size(sensor: Sensor) -> float:
    """Upper bound of the width of a spot at 1/e^2, mm."""
    return max(sensor.beam.diameter_x, sensor.beam.diameter_y)


def edge_distance(sensor: Sensor) -> float:
    """Distance from a detector's edge within which a spot counts as near it, mm; see
    `is_near_edge`."""
    size = spot_size(sensor)
    return 1.5 * size + MIN_EDGE_DISTANCE_MM if sensor.light.wavelength > 0 else size


def is_near_edge(sensor: Sensor, reading: ArrayLike) -> NDArray[np.bool_]:
    """Whether spots of readings (..., 9) are nearer to an edge than `edge_distance`: (..., 3).

    Light that is lost past an edge is in the model only with `Apertures.detectors`. The loss by
    diffraction is in the model only where the light of the mirror's edges is farther than
    MIN_EDGE_DISTANCE_MM from the detector's edge. This light may be half a spot's width off the
    spot. False where a detector has no reading.
    """
    array = np.asarray(reading, dtype=np.float64)
    y, z = half_sizes(sensor).T - edge_distance(sensor)
    near: NDArray[np.bool_] = (np.abs(array[..., 0::3]) > y) | (np.abs(array[..., 1::3]) > z)
    return near


def is_on_detector(sensor: Sensor, reading: ArrayLike) -> NDArray[np.bool_]:
    """Whether spots of readings (..., 9) lie on their detector's sensitive area: (..., 3)."""
    array = np.asarray(reading, dtype=np.float64)
    y, z = half_sizes(sensor).T
    inside: NDArray[np.bool_] = (np.abs(array[..., 0::3]) <= y) & (np.abs(array[..., 1::3]) <= z)
    return inside


def mask_missed_spots(sensor: Sensor, place: ArrayLike, reading: ArrayLike) -> Floats:
    """Replace the readings (..., 9) of detectors whose spots miss them by NaN.

    place: (..., 9) readings without noise, which have the places of spots also past an edge.
    """
    masked = np.array(reading, dtype=np.float64)
    masked[~np.repeat(is_on_detector(sensor, place), 3, axis=-1)] = np.nan
    return masked


@check_arguments
def reaches(sensor: Sensor, state: ArrayLike) -> NDArray[np.bool_]:
    """Test whether the spots' centroids lie on their detector's sensitive area.

    Parameters
    ----------
    sensor
        The sensor.
    state
        States tx, ty, tz, roll, pitch, yaw, bx, by, (..., 8); mm and rad, world frame.

    Returns
    -------
    ndarray of bool
        (..., 3), of detectors A, B, C; False also where the sub-beam never meets the detector's
        plane.

    Examples
    --------
    >>> import facets
    >>> facets.reaches(facets.Sensor(), [0, 0, 8, 0, 0, 0, 0, 0]).tolist()  # 8 mm up: past the edge
    [False, False, False]
    """
    return is_on_detector(sensor, readings(sensor, state))


@check_arguments
def footprints(sensor: Sensor, state: ArrayLike, threads: int = 1) -> Floats:
    """Compute the ends of the spots of the light inside the 1/e^2 circle or a smaller aperture.

    Parameters
    ----------
    sensor
        The sensor.
    state
        States tx, ty, tz, roll, pitch, yaw, bx, by, (..., 8); mm and rad, world frame.
    threads
        Number of threads that share the states; 0 for all cores.

    Returns
    -------
    ndarray
        (..., 3, 5), mm: lowest and highest psi, lowest and highest zeta on each detector's plane
        (detector frame), and the largest distance from the mirror's axis at which the light meets
        the facet. NaN where a facet meets no light inside the circle, where it is turned past the
        beam, and where its sub-beam never meets the detector's plane.

    Examples
    --------
    >>> import numpy as np, facets
    >>> least, largest = facets.footprints(facets.Sensor(), np.zeros(8))[0, :2]
    >>> f"spot A spans {largest - least:.2f} mm along y"
    'spot A spans 0.74 mm along y'
    """
    if (single := evaluate_one(sensor, "footprints", state, threads)) is not None:
        return single
    rows, shape = as_rows(state, 8, "state")
    return evaluate(sensor, "footprints", rows, threads).reshape(*shape, 3, 5)


@check_arguments
def margins(sensor: Sensor, state: ArrayLike, whole: bool = True, threads: int = 1) -> Floats:
    """Compute the distance of each spot from each of its limits.

    Parameters
    ----------
    sensor
        The sensor.
    state
        States tx, ty, tz, roll, pitch, yaw, bx, by, (..., 8); mm and rad, world frame.
    whole
        True for the footprint inside the 1/e^2 circle, False for the centroid.
    threads
        Number of threads that share the states; 0 for all cores.

    Returns
    -------
    ndarray
        (..., 3, 5), mm, positive inside: distances from the edges at -y, +y, -z and +z of detectors
        A, B, C, and from the mirror's rim, perpendicular to its axis. The latter is infinite where
        `sensor.apertures` has no rim, and is that of the footprint also with `whole=False`. NaN as
        from `footprints` and `readings`.

    Examples
    --------
    >>> import numpy as np, facets
    >>> edges = facets.margins(facets.Sensor(), np.zeros(8))[0, :4]
    >>> f"spot A is {edges.min():.2f} mm from an edge"
    'spot A is 6.08 mm from an edge'
    """
    ends = footprints(sensor, state, threads)
    if not whole:
        ends[..., :4] = centroids_as_ends(readings(sensor, state, threads=threads))
    return edge_distances(ends, edge_limits(half_sizes(sensor), sensor.apertures.rim))


def centroids_as_ends(reading: Floats) -> Floats:
    """The ends (..., 3, 4) of spots without width at the centroids of readings (..., 9)."""
    places = np.stack([reading[..., 0::3], reading[..., 1::3]], axis=-1)
    ends: Floats = np.repeat(places, 2, axis=-1)
    return ends


def edge_limits(halves: Floats, rim: float) -> Floats:
    """Distances from the middle to the limits of a spot, in the order of `margins`: (..., 3, 5) mm.

    halves: (..., 3, 2) of the detectors along y and z, mm.  rim: the mirror's radius, mm.
    """
    edges = np.repeat(halves, 2, axis=-1)
    limits: Floats = np.concatenate([edges, np.full((*edges.shape[:-1], 1), rim)], axis=-1)
    return limits


def edge_distances(ends: Floats, limits: Floats) -> Floats:
    """The `margins` of spots, mm.

    ends: (..., 3, 5) from `footprints`.  limits: (..., 3, 5) from `edge_limits`.
    """
    distances: Floats = limits + ends * np.array([1.0, -1.0, 1.0, -1.0, -1.0])
    return distances
