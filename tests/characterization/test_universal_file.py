"""A universal file says what it holds, to readers that share no code with its writer.

`experiments/frequency_responses.py` has the modes that modal analysis finds in many recordings.
"""

from dataclasses import replace

import numpy as np
import pytest

from facets import InputError
from facets.characterization import (
    estimate_response,
    find_stretches,
    input_type,
    read_input_dof,
    write_universal_file,
)
from facets.core import Mode, Vibration
from facets.simulation import receptance, shake

MODES = {
    "bounce": Mode(62.0, 0.012, (0.0, 0.001, 0.009, 0.0, 0.0, 0.0)),
    "rock": Mode(97.0, 0.009, (0.0, 0.0007, 0.0, 4e-5, 0.0, 0.0)),
    "twist": Mode(171.0, 0.007, (0.0004, 0.0, 0.0, 0.0, 0.0, 6e-5)),
}
ABOUT = {"config": "shaker", "facets": "1", "made": "2026-11-23T05:32:23+00:00"}


def respond(samples, resolution):
    body = Vibration(MODES, low=5.0, high=400.0, samples=samples, rate=1000.0)
    stretches = find_stretches(np.arange(samples) / 1000, np.ones(samples, bool), "it")
    rng = np.random.default_rng(1)
    force, moved = shake(body, rng)
    moved = moved + 1e-7 * rng.standard_normal(moved.shape)
    return estimate_response(force, moved, stretches, resolution)


@pytest.mark.installed
def test_a_file_has_nodes_directions_units_and_types(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    path, response = tmp_path / "body.uff", respond(4000, 2.0)
    write_universal_file(path, response, "force_mn", 7, (2, -3), (1.0, 0.0, 50.0), ABOUT)
    file = pyuff.UFF(str(path))
    assert file.get_set_types().tolist() == [151, 164, 15, *[58] * 12]
    head, units, places, *functions = file.read_sets()
    assert (head["model_name"].strip(), head["program"].strip()) == ("shaker", "facets")
    assert (units["units_code"], units["length"], units["force"]) == (1, 1.0, 1.0)
    assert [places[name][0] for name in ("node_nums", "x", "z")] == [7, 1e-3, 0.05]
    units = np.repeat([1e-3, 1], 3) * 1e3  # the input is in mN
    about = ("func_type", "ordinate_spec_data_type", "orddenom_spec_data_type")
    for measured, expected, sets in (
        (response.h1 * units, [4, 8, 13], functions[:6]),
        (response.coherence, [6, 0, 0], functions[6:]),
    ):
        for axis, one in enumerate(sets):
            assert [one[name] for name in about] == expected
            assert (one["rsp_node"], one["rsp_dir"]) == (7, axis + 1)
            assert (one["ref_node"], one["ref_dir"]) == (2, -3)
            assert one["abscissa_spec_data_type"] == 18
            assert one["x"] == pytest.approx(2.0 * np.arange(len(one["x"])))
            assert (one["data"][:2] == 0).all()
            assert one["data"][2:] == pytest.approx(measured[:, axis], rel=1e-11)
    assert functions[5]["ordinate_axis_units_lab"].strip() == "rad"
    assert functions[2]["id1"].strip() == "Frequency response function H1 of tz by force_mn"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_modal_analysis_finds_the_modes_of_an_exact_receptance(tmp_path):
    ema = pytest.importorskip("sdypy.EMA")
    path, response = tmp_path / "body.uff", respond(60_000, 0.125)
    response = replace(response, h1=receptance(Vibration(MODES), response.frequency))
    write_universal_file(path, response, "force_n", 1, (0, 0), (0.0, 0.0, 0.0), ABOUT)
    model = ema.Model(lower=20, upper=300, pol_order_high=24)
    model.read_uff(str(path))
    assert model.frf_form == "receptance"
    model.get_poles(show_progress=False)
    model.select_closest_poles([62, 97, 171], f_window=8)
    assert model.nat_freq == pytest.approx([62, 97, 171], rel=2e-3)
    assert model.nat_xi == pytest.approx([0.012, 0.009, 0.007], rel=2e-3)


def test_where_the_input_acts_is_read():
    assert read_input_dof("2:-tz") == (2, -3)
    assert read_input_dof("12:yaw") == (12, 6)
    assert read_input_dof("3:+roll") == (3, 4)
    for text in ("tz", "2:x", "-1:tx", "2:--tz"):
        with pytest.raises(InputError, match="allowed: NODE:AXIS"):
            read_input_dof(text)


def test_the_input_has_the_type_of_its_unit():
    for column, expected in {
        "force_kn": (13, "N", 1e3),
        "torque_n_m": (13, "N m", 1.0),
        "base_m_s2": (12, "m/s^2", 1.0),
        "current_a": (0, "NONE", 1.0),
        "force": (0, "NONE", 1.0),
    }.items():
        assert input_type(column) == expected, column
