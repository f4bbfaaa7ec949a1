"""A universal file says what it holds, to readers that share no code with its writer."""

import numpy as np
import pytest

from facets import InputError
from facets.responses import (
    FORMS,
    InputChannel,
    Node,
    estimate_response,
    find_stretches,
    input_type,
    read_input_dof,
    write_universal_file,
)

ABOUT = {"config": "shaker", "facets": "1", "made": "2026-11-23T05:32:23+00:00"}


@pytest.fixture
def written(tmp_path):
    """Writes a universal file, and returns it as pyuff reads it."""
    pyuff = pytest.importorskip("pyuff")

    def write(sets, place):
        write_universal_file(tmp_path / "body.uff", sets, place, ABOUT)
        return pyuff.UFF(str(tmp_path / "body.uff"))

    return write


def estimate(stimulus, others=None):
    stretches = find_stretches(np.arange(4000) / 1000, np.ones(4000, bool), "it")
    moved = np.random.default_rng(2).standard_normal((4000, 6))
    return estimate_response(stimulus, moved, stretches, 2.0, others=others)


FORCES = np.random.default_rng(1).standard_normal((4000, 2))


@pytest.mark.installed
def test_a_file_has_nodes_directions_units_and_types(written):
    response = estimate(FORCES[:, 0])
    file = written([(response, InputChannel("force_mn", 2, -3))], Node(7, (1.0, 0.0, 50.0)))
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


@pytest.mark.installed
def test_forms_and_partial_coherences_say_what_they_are(written):
    found = estimate(FORCES[:, 1], FORCES[:, :1])
    sets = [(found.convert(FORMS["accelerance"]), InputChannel(name)) for name in ("a_n", "b_n")]
    functions = written(sets, Node(1, (0.0, 0.0, 0.0))).read_sets()[3:]
    assert len(functions) == 24
    response, coherence = functions[14], functions[20]
    assert (response["ordinate_spec_data_type"], response["orddenom_spec_data_type"]) == (12, 13)
    assert response["ordinate_axis_units_lab"].strip() == "m/s^2"
    turn = 2 * np.pi * response["x"][2:]
    assert response["data"][2:] == pytest.approx(-(turn**2) * found.h1[:, 2] / 1e3)
    assert coherence["id1"].strip() == "Partial coherence of tz by b_n"


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
