"""Write frequency response functions as a universal file (UFF) for programs of modal analysis.

Dataset 151 is the header, 164 the units (SI), 15 the node. A dataset 58, "function at nodal degree
of freedom", follows for each response (function type 4) and each coherence (type 6), which is the
partial coherence if there are several inputs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core import ANGLES, POSE, InputError, require_extra
from ..files import Whole
from .frequency_response import FrequencyResponse

#: Types of data in a universal file.
FREQUENCY, DISPLACEMENT, VELOCITY, ACCELERATION, FORCE, UNKNOWN = 18, 8, 11, 12, 13, 0
FRF, COHERENCE = 4, 6
#: Type of a motion and the end of its SI unit, by the order of its time derivative.
MOTIONS = ((DISPLACEMENT, ""), (VELOCITY, "/s"), (ACCELERATION, "/s^2"))
#: Type of an input, its SI unit and the factor to this unit, by the ending of its column.
INPUTS = {
    "n": (FORCE, "N", 1.0), "mn": (FORCE, "N", 1e-3), "kn": (FORCE, "N", 1e3),
    "m_s2": (ACCELERATION, "m/s^2", 1.0), "mm_s2": (ACCELERATION, "m/s^2", 1e-3),
    "n_m": (FORCE, "N m", 1.0),
}  # fmt: skip
#: Directions by axis: translations 1 to 3, rotations 4 to 6.
DIRECTIONS = {name: n for n, name in enumerate(POSE, 1)}


class Node(NamedTuple):
    """The point at which responses were measured.  number: of the node in the model of the
    structure.  place: (3,) coordinates, mm."""

    number: int
    place: Sequence[float]


class InputChannel(NamedTuple):
    """The input of the responses.  column: its column in the table, with the unit at its end.
    node, direction: its degree of freedom, as `read_input_dof` returns it; 0, 0 if unknown."""

    column: str
    node: int = 0
    direction: int = 0


def input_type(column: str) -> tuple[int, str, float]:
    """Code, SI unit and factor to this unit of an input, by the unit at the end of its column."""
    words = column.lower().split("_")
    endings = ("_".join(words[n:]) for n in range(1, len(words)))
    return next((INPUTS[ending] for ending in endings if ending in INPUTS), (UNKNOWN, "NONE", 1.0))


def read_input_dof(text: str) -> tuple[int, int]:
    """Parse "2:-tz" as the node and the direction (6: +Z rotation, -3: -Z translation).

    Raises `InputError` for any other form.
    """
    match = re.fullmatch(rf"(\d{{1,7}}):([+-]?)({'|'.join(POSE)})", text.strip())
    if match is None:
        raise InputError(
            f"--input-dof is {text!r}; allowed: NODE:AXIS with AXIS one of {', '.join(POSE)}, "
            "with a minus sign for the opposite direction, such as 2:-tz"
        )
    node, sign, axis = match.groups()
    return int(node), DIRECTIONS[axis] * (-1 if sign == "-" else 1)


def write_universal_file(
    path: Path,
    responses: Sequence[tuple[FrequencyResponse, InputChannel]],
    node: Node,
    about: Mapping[str, str],
) -> None:
    """Write responses of a node, the point of interest, to one or several inputs.

    about: provenance of the responses, by key.
    """
    pyuff = require_extra("pyuff", f"--uff {path}")
    sets = [*head_sets(node, about)]
    for response, stimulus in responses:
        for function in (FRF, COHERENCE):
            sets += [function_set(response, axis, function, stimulus, node, about) for axis in POSE]
    with Whole(path) as temporary:
        pyuff.UFF(str(temporary)).write_sets(sets, "overwrite")


def head_sets(node: Node, about: Mapping[str, str]) -> list[dict[str, Any]]:
    """The header, the units and the node."""
    made = about.get("made", "")
    date, _, time = made.partition("T")
    header = {
        "type": 151, "model_name": about.get("config", "NONE")[:80], "description": "facets",
        "db_app": f"facets {about.get('facets', '')}", "date_db_created": date[2:] or "NONE",
        "time_db_created": time[:8] or "NONE", "version_db1": 0, "version_db2": 0, "file_type": 0,
        "date_db_saved": date[2:] or "NONE", "time_db_saved": time[:8] or "NONE",
        "program": "facets", "date_db_written": date[2:] or "NONE",
        "time_db_written": time[:8] or "NONE",
    }  # fmt: skip
    units = {
        "type": 164, "units_code": 1, "units_description": "SI: Meter (newton)", "temp_mode": 1,
        "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15,
    }  # fmt: skip
    x, y, z = (np.array([1e-3 * value]) for value in node.place)
    places = {
        "type": 15, "node_nums": np.array([node.number]), "def_cs": np.array([0]),
        "disp_cs": np.array([0]), "color": np.array([11]), "x": x, "y": y, "z": z,
    }  # fmt: skip
    return [header, units, places]


def function_set(
    response: FrequencyResponse,
    axis: str,
    function: int,
    stimulus: InputChannel,
    node: Node,
    about: Mapping[str, str],
) -> dict[str, Any]:
    """Dataset 58 of one axis: its response in m or rad (per s, s^2) per SI unit of the input, or
    its coherence.

    The lines begin at 0 Hz, which methods by inverse transforms require. Lines that are not
    estimated, at low frequencies and between the lines of a periodic input, are zero.
    """
    kind, unit, scale = input_type(stimulus.column)
    n, step = POSE.index(axis), response.resolution
    lines = np.round(response.frequency / step).astype(int)
    length = 1.0 if axis in ANGLES else 1e-3
    is_response = function == FRF
    values = response.h1 * length / scale if is_response else response.coherence
    estimated = np.nan_to_num(values[:, n])
    data = np.zeros(lines[-1] + 1, estimated.dtype)
    data[lines] = estimated
    window = "no" if response.period else "Hann"
    coherence = "Coherence" if response.multiple_coherence is None else "Partial coherence"
    words = "Frequency response function H1" if is_response else coherence
    motion, per_time = MOTIONS[response.form.order]
    si_unit = ("rad" if axis in ANGLES else "m") + per_time
    return {
        "type": 58, "binary": 0, "func_type": function,
        "id1": f"{words} of {axis} by {stimulus.column}"[:80],
        "id2": f"{response.averages:.1f} averages, {window} window, {step:.6g} Hz; facets"[:80],
        "id3": about.get("made", "NONE")[:80],
        "id4": about.get("config", "NONE")[:80],
        "id5": f"Not estimated below {response.frequency[0]:.6g} Hz, where it is zero"[:80],
        "rsp_ent_name": "NONE", "rsp_node": node.number, "rsp_dir": DIRECTIONS[axis],
        "ref_ent_name": "NONE", "ref_node": stimulus.node, "ref_dir": stimulus.direction,
        "abscissa_spacing": 1, "abscissa_spec_data_type": FREQUENCY,
        "abscissa_axis_lab": "Frequency", "abscissa_axis_units_lab": "Hz",
        "ordinate_spec_data_type": motion if is_response else UNKNOWN,
        "ordinate_axis_lab": axis,
        "ordinate_axis_units_lab": si_unit if is_response else "NONE",
        "orddenom_spec_data_type": kind if is_response else UNKNOWN,
        "orddenom_axis_lab": stimulus.column[:20],
        "orddenom_axis_units_lab": unit if is_response else "NONE",
        "z_axis_spec_data_type": UNKNOWN,
        "x": step * np.arange(len(data)), "data": data,
    }  # fmt: skip
