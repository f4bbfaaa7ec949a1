"""Write a sensor's constants in C, and check that the C code supports the sensor."""

from __future__ import annotations

import numpy as np

from ..core.errors import InputError
from ..core.sensor import Grid, Sensor
from ..detectors.correction import coefficients, is_corrected
from ..detectors.counts import counts_per_ampere
from ..detectors.noise import CHARGE, current_variances, has_two_layers, power_floor
from ..estimation.doubts import has_fold
from ..estimation.plan import make_limits
from ..model.arrays import half_sizes
from .c_numbers import number


def refuse_sensor(sensor: Sensor) -> None:
    """Raise `InputError`, with the reason, for a sensor that the C code does not support."""
    if any(sensor.light.delays):
        raise InputError(
            "the detectors are read at different times (`light.delays`), which the C code does not "
            "allow for; read them together, or solve on a PC"
        )
    if sensor.electronics is not None and sensor.electronics.kind == "tetra-lateral":
        raise InputError(
            "the detectors are tetra-lateral, whose places follow from an iteration that is not "
            "part of the C code; use duo-lateral or pincushion detectors"
        )
    if has_fold(sensor):
        raise InputError(
            "in this head the determinant of Eq. (11) changes its sign, so that two poses may give "
            "one reading, which the C code cannot detect; see `facets jacobian`"
        )


def sensor_data(sensor: Sensor) -> str:
    """C definitions of the sensor's constants."""
    limits = make_limits(sensor, False)
    distance = max(float(np.hypot(psd.radius, psd.height)) for psd in sensor.psds)
    parts = [
        define("BEAM_POWER", sensor.beam.power, "mW"),
        define("FARTHEST", distance, "mm, of a detector"),
        define("POWER_FLOOR", power_floor(sensor), "mW, standard deviation without light"),
        f"#define CUTS_AT_EDGES {int(sensor.apertures.detectors)} /* of the detectors */",
        array("USABLE", limits.usable, "mm, lowest and highest psi and zeta of use"),
        array("LEAST_LIGHT", limits.light, "mW, of a reading that counts, and of any light"),
        noise_data(sensor),
        correction_data(sensor),
    ]
    if sensor.electronics is not None or is_corrected(sensor) or sensor.apertures.detectors:
        parts.append(array("HALF_SIZES", half_sizes(sensor), "mm, along y and z"))
    return "\n".join(parts)


def noise_data(sensor: Sensor) -> str:
    e = sensor.electronics
    if e is None:
        place = sensor.noise.position * sensor.noise.at_power
        return "#define ELECTRODES 0\n" + define(
            "NOISE_OF_PLACES", place, "mm mW: a place's standard deviation times the power"
        )
    even = float(current_variances(e, np.zeros(4))[0].sum())
    lines = [
        "#define ELECTRODES 1",
        f"#define PINCUSHION {int(not has_two_layers(e))}",
        define("RESPONSIVITY", 1e-3 * e.responsivity, "A/mW"),
        define("SHOT_NOISE", 2 * CHARGE * e.bandwidth, "A^2 for each A"),
        define("EVEN_NOISE", even, "A^2, of an electrode without light"),
        define("COUNTS_PER_MILLIWATT", 1e-3 * e.responsivity * counts_per_ampere(e)),
        f"#define CONVERTER_TOP {largest_count(e.adc_bits)} /* counts at the converter's end */",
    ]
    return "\n".join(lines)


def largest_count(bits: int) -> int:
    """Largest count of a converter with this many bits, limited to the 32 bits of a frame."""
    return int(min(2**bits - 1, 2**31 - 1))


def correction_data(sensor: Sensor) -> str:
    grids = [psd.correction.grid for psd in sensor.psds]
    lines = [
        f"#define CORRECTED {int(is_corrected(sensor))}",
        f"#define GRIDS {int(any(grid is not None for grid in grids))}",
    ]
    if is_corrected(sensor):
        lines.append(
            array(
                "CORRECTIONS",
                coefficients(sensor).reshape(3, -1),
                "share of the power, dark power (mW), then of y and of z (mm) by monomials",
            )
        )
    if any(grid is not None for grid in grids):
        lines.append(grid_data(grids))
    return "\n".join(lines)


def grid_data(grids: list[Grid | None]) -> str:
    lines = [
        "typedef struct {",
        "    int rows, columns;",
        "    const facets_real *y, *z, *add_y, *add_z;",
        "} Grid;",
    ]
    rows = []
    for letter, grid in zip("ABC", grids, strict=True):
        if grid is None:
            rows.append("    {0, 0, NULL, NULL, NULL, NULL},")
            continue
        names = [f"GRID_{letter}_{name}" for name in ("Y", "Z", "ADD_Y", "ADD_Z")]
        parts = [np.array(part) for part in (grid.y, grid.z, grid.add_y, grid.add_z)]
        lines += [array(n, part.ravel()) for n, part in zip(names, parts, strict=True)]
        rows.append(f"    {{{len(grid.y)}, {len(grid.z)}, {', '.join(names)}}},")
    return "\n".join([*lines, "static const Grid GRID[3] = {", *rows, "};"])


def define(name: str, value: float, unit: str = "") -> str:
    return f"#define {name} {number(value)}" + (f" /* {unit} */" if unit else "")


def array(name: str, values: np.ndarray, unit: str = "") -> str:
    """Write a constant array of one or two dimensions."""
    comment = f" /* {unit} */" if unit else ""
    size = "".join(f"[{n}]" for n in values.shape)
    if values.ndim == 1:
        return f"static const facets_real {name}{size} = {{{row(values)}}};{comment}"
    lines = [f"    {{{row(part)}}}," for part in values]
    return "\n".join([f"static const facets_real {name}{size} = {{{comment}", *lines, "};"])


def row(values: np.ndarray) -> str:
    return ", ".join(number(float(value)) for value in values)
