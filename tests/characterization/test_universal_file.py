"""A universal file says what it holds, to readers that share no code with its writer.

`experiments/studies/frequency_responses.py` has the modes that modal analysis finds in many
recordings.
"""

import numpy as np
import pytest

from facets import InputError
from facets.characterization import (
    InputChannel,
    Node,
    estimate_response,
    find_stretches,
    input_type,
    read_input_dof,
    write_universal_file,
)

ABOUT = {"config": "shaker", "facets": "1", "made": "2026-11-23T05:32:23+00:00"}


@pytest.mark.installed
def test_a_file_has_nodes_directions_units_and_types(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    rng, path = np.random.default_rng(1), tmp_path / "body.uff"
    stretches = find_stretches(np.arange(4000) / 1000, np.ones(4000, bool), "it")
    response = estimate_response(
        rng.standard_normal(4000), rng.standard_normal((4000, 6)), stretches, 2.0
    )
    place = Node(7, (1.0, 0.0, 50.0))
    write_universal_file(path, response, InputChannel("force_mn", 2, -3), place, ABOUT)
    file = pyuff.UFF(str(path))
    assert file.get_set_types().tolist() == [151, 164, 15, *[58] * 12]
    head, units, places, *functions = file.read_sets()
    assert (head["model_name"].strip(), head["program"].strip()) == ("shaker", "facets")
    assert (units["units_code"], units["length"], units["force"]) == (1, 1.0, 1.0)
    assert [places[name][0] for name in ("node_nums", "x", "z")] == [7, 1e-3, 0.05]
    units = np.repeat([1, 1e3], 3)  # the response is in mm, the input in mN
    kinds = ("func_type", "ordinate_spec_data_type", "orddenom_spec_data_type")
    places = ("rsp_node", "ref_node", "ref_dir", "abscissa_spec_data_type", "rsp_dir")
    measured = np.hstack([response.h1 * units, response.coherence])
    for n, function in enumerate(functions):
        assert [function[name] for name in kinds] == ([4, 8, 13] if n < 6 else [6, 0, 0])
        assert [function[name] for name in places] == [7, 2, -3, 18, n % 6 + 1]
        values = np.append([0, 0], measured[:, n])
        assert function["data"] == pytest.approx(values, rel=1e-11)
        assert function["x"] == pytest.approx(2.0 * np.arange(len(values)))
    assert functions[5]["ordinate_axis_units_lab"].strip() == "rad"
    assert functions[2]["id1"].strip() == "Frequency response function H1 of tz by force_mn"


def test_where_the_input_acts_is_read():
    assert read_input_dof("2:-tz") == (2, -3)
    assert read_input_dof("12:+yaw") == (12, 6)
    for text in ("tz", "2:x", "-1:tx", "2:--tz"):
        with pytest.raises(InputError, match="allowed: NODE:AXIS"):
            read_input_dof(text)


def test_the_input_has_the_type_of_its_unit():
    for column, expected in {
        "force_kn": (13, "N", 1e3),
        "torque_n_m": (13, "N m", 1.0),
        "base_m_s2": (12, "m/s^2", 1.0),
        "current_a": (0, "NONE", 1.0),
    }.items():
        assert input_type(column) == expected
