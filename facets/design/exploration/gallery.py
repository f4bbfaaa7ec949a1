"""The designs that a page shows: the present sensor, the front, and some others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.sensor import Sensor
from ...core.units import Booleans, Floats
from ...files.columns import join_columns
from ...files.provenance import require_origin
from ...files.tables import read_chunks, read_head
from ..optimisation.rounding import nearest_steps
from ..variables import present_values, sensor_of
from .space import MEASURES, Space, measure_design, measure_designs
from .survey import SKIPPED

if TYPE_CHECKING:
    from ...core.settings import Config

#: Largest numbers of designs on a page: of the front, and others.
FRONT, OTHERS = 200, 400
Table = dict[str, NDArray[Any]]


def present_design(space: Space) -> tuple[Floats, Floats, str]:
    """Return the present sensor's variables (names,), its measures, and the reason if some are
    missing."""
    fixed = replace(space, layout=replace(space.layout, variables={}))
    why, values = measure_design(fixed, np.empty(0))
    now = present_values(space.sensor)
    return np.array([now[name] for name in space.names]), values, SKIPPED[why]


def spread_numbers(count: int, most: int) -> NDArray[np.int64]:
    """Return (m,) at most `most` numbers below `count`, evenly spaced."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def gallery(space: Space, front: Table, others: Table | None) -> tuple[Table, list[Sensor]]:
    """Return a table of the present design, the front's designs and some others, and all their
    sensors, in manufacturable values.

    front, others: tables with the variables and measures; the front's column `holds_it_back` may
    name active constraints.
    """
    names = [*space.names, *MEASURES]
    x, values, _ = present_design(space)
    shown = spread_numbers(len(front[names[0]]), FRONT)
    titles = [f"front {n}" for n in front.get("point", front.get("design", shown))[shown]]
    remarks = front.get("holds_it_back", np.full(len(front[names[0]]), ""))[shown].tolist()
    chosen = np.empty(0, dtype=np.int64)
    if others is not None:
        chosen = choose_others(space, front, others)
        titles += [f"design {n}" for n in others["design"][chosen]]
    rows = np.stack(
        [
            np.concatenate([front[name][shown], *([others[name][chosen]] if others else [])])
            for name in names
        ],
        axis=1,
    )
    every_row = np.concatenate([np.append(x, values)[None], round_designs(space, rows)])
    table: Table = {name: every_row[:, n].astype(float) for n, name in enumerate(names)}
    table["kind"] = np.array(["own"] + ["front"] * len(shown) + ["other"] * len(chosen))
    table["title"] = np.array(["as it is", *titles])
    table["remark"] = np.array(["", *remarks] + [""] * len(chosen))
    sensors = [
        sensor_of(space.sensor, space.names, row[: len(space.names)]) for row in every_row[1:]
    ]
    return table, [space.sensor, *sensors]


def choose_others(space: Space, front: Table, others: Table) -> NDArray[np.int64]:
    """Row numbers (m,) of some designs that have all objectives and are not on the front."""
    complete = np.all([np.isfinite(others[n]) for n in space.objectives], axis=0)
    candidates = np.flatnonzero(complete & ~np.isin(others["design"], front.get("design", [])))
    return candidates[spread_numbers(len(candidates), OTHERS)] if len(candidates) else candidates


def round_designs(space: Space, rows: Floats) -> Floats:
    """Round designs, rows of variables and measures, to manufacturable values, and measure them
    again. A design that would then lack a measure stays unrounded."""
    count = len(space.names)
    x = np.array([round_to_steps(space, row[:count]) for row in rows]).reshape(-1, count)
    if not len(x):
        return rows
    why, values = measure_designs(space, x)
    return np.where((why == 0)[:, None], np.concatenate([x, values], axis=1), rows)


def round_to_steps(space: Space, x: Floats) -> Floats:
    """Round a design (names,) to manufacturable values."""
    low, high = np.array([space.layout.variables[name] for name in space.names]).T
    return nearest_steps(space.names, x, low, high)


def texts_of(settings: Config, sensors: list[Sensor], folder: Any) -> list[str]:
    """The YAML of each sensor, as an extension of the configuration."""
    from ..results.changes import (
        base_of,
        changed_keys,
        common_keys_hold,
        document,
        merge_common_blocks,
    )

    base = base_of(settings, folder)
    once = common_keys_hold(settings, sensors[-1], folder)
    keys = [changed_keys(settings, sensor) for sensor in sensors]
    return [document(base, merge_common_blocks(each) if once else each, {}) for each in keys]


def best_of(table: Table, objectives: list[str], mask: Booleans) -> Table:
    """The designs that the mask selects, sorted by the first objective."""
    chosen = {name: column[mask] for name, column in table.items()}
    order = np.argsort(chosen[objectives[0]], kind="stable")
    return {name: column[order] for name, column in chosen.items()}


def choose_design(settings: Config, space: Space, file: Path, number: int) -> Floats:
    """Read the variables of one design from the front.csv or pareto.csv of an earlier run of the
    configuration: (names,), in the units of their names. Raises `InputError` if there is none."""
    if not file.is_file():
        raise InputError(f"{file}: no such file; run `facets explore` first, or name its folder "
                         "by --folder")  # fmt: skip
    remedy = f"name the configuration that it was made from, or explore {settings.name} first"
    require_origin(file, read_head(file), settings, remedy)
    return read_design(file, "point" if file.stem == "pareto" else "design", space.names, number)


def read_design(file: Path, key: str, names: list[str], number: int) -> Floats:
    """Read the named variables of the row with this number in the column `key`: (names,). Raises
    `InputError` if there is none."""
    table = join_columns([chunk.columns for chunk in read_chunks(file, [key, *names])])
    rows = np.flatnonzero(table[key] == number)
    if not len(rows):
        first_numbers = ", ".join(f"{n:.0f}" for n in table[key][:8])
        raise InputError(f"{file}: has no {key} {number}; it has {first_numbers} and so on")
    return np.array([table[name][rows[0]] for name in names])


def make_buildable(space: Space, x: Floats) -> tuple[Floats, list[str]]:
    """Round a design (names,) to manufacturable values if it remains valid; also return sentences
    on the loss, or on the reason for not rounding."""
    rounded = round_to_steps(space, x)
    (_, exact), (why, values) = measure_design(space, x), measure_design(space, rounded)
    if why:
        return x, [f"The design was not rounded to manufacturable values: {SKIPPED[why]}"]
    places = [(name, MEASURES.index(name)) for name in space.objectives]
    return rounded, [f"{n}: {exact[i]:.4g} as found, {values[i]:.4g} rounded" for n, i in places]
