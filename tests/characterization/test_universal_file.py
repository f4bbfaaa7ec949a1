"""A universal file says what it holds, to readers that share no code with its writer."""

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


def respond(samples, resolution, seed=1):
    rng = np.random.default_rng(seed)
    body = Vibration(MODES, low=5.0, high=400.0, samples=samples, rate=1000.0)
    force, moved = shake(body, rng)
    noise = np.array([66e-6, 66e-6, 42e-6, 1.2e-7, 1.2e-7, 1.7e-7])
    stretches = find_stretches(np.arange(samples) / 1000, np.ones(samples, bool), "it")
    moved = moved + noise * rng.standard_normal(moved.shape)
    return estimate_response(force, moved, stretches, resolution, noise)


@pytest.mark.installed
def test_a_file_has_nodes_directions_units_and_types(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    path, found = tmp_path / "body.uff", respond(4000, 2.0)
    write_universal_file(path, found, "force_mn", 7, (2, -3), (1.0, 0.0, 50.0), ABOUT)
    file = pyuff.UFF(str(path))
    assert file.get_set_types().tolist() == [151, 164, 15, *[58] * 12]
    head, units, places, *functions = file.read_sets()
    assert (head["model_name"].strip(), head["program"].strip()) == ("shaker", "facets")
    assert (units["units_code"], units["length"], units["force"]) == (1, 1.0, 1.0)
    assert [places[name][0] for name in ("node_nums", "x", "z")] == [7, 1e-3, 0.05]
    for n, one in enumerate(functions):
        function = 4 if n < 6 else 6
        assert (one["func_type"], one["rsp_node"], one["rsp_dir"]) == (function, 7, n % 6 + 1)
        assert (one["ref_node"], one["ref_dir"]) == (2, -3)
        assert one["x"] == pytest.approx(0.002 * np.arange(len(one["x"])) * 1000)
        assert (one["data"][:2] == 0).all()
        measured = found.h1 if n < 6 else found.coherence
        length = 1 if n % 6 > 2 or n > 5 else 1e-3
        size = measured[:, n % 6] * length * (1e3 if n < 6 else 1)  # the input is in mN
        assert one["data"][2:] == pytest.approx(size, rel=1e-11)
        assert one["abscissa_spec_data_type"] == 18
        kinds = (8, 13) if n < 6 else (0, 0)
        assert (one["ordinate_spec_data_type"], one["orddenom_spec_data_type"]) == kinds
    assert functions[5]["ordinate_axis_units_lab"].strip() == "rad"
    assert functions[2]["id1"].strip() == "Frequency response function H1 of tz by force_mn"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_modal_analysis_of_the_file_finds_the_modes_within_their_uncertainty(tmp_path):
    """By a program of others. The uncertainty is how far the modes scatter over recordings; what
    the program makes of the exact receptance is its own error."""
    ema = pytest.importorskip("sdypy.EMA")

    def identify(response):
        path = tmp_path / "body.uff"
        write_universal_file(path, response, "force_n", 1, (0, 0), (0.0, 0.0, 0.0), ABOUT)
        model = ema.Model(lower=20, upper=300, pol_order_high=24)
        model.read_uff(str(path))
        assert model.frf_form == "receptance"
        model.get_poles(show_progress=False)
        model.select_closest_poles([62, 97, 171], f_window=8)
        return np.concatenate([model.nat_freq, model.nat_xi])

    responses = [respond(120_000, 0.125, seed) for seed in range(6)]
    body = Vibration(MODES)
    exact = identify(replace(responses[0], h1=receptance(body, responses[0].frequency)))
    true = np.array([62, 97, 171, 0.012, 0.009, 0.007])
    assert np.abs(exact / true - 1).max() < 2e-3
    found = np.array([identify(one) for one in responses])
    sigma = found.std(axis=0, ddof=1)
    assert (sigma / true < [5e-5] * 3 + [0.01] * 3).all()
    # beside the scatter a hundredth of the half-power width and of the damping: least squares on
    # noisy responses, and leakage at 12 to 19 lines in the width
    width = 2 * true[:3] * true[3:]
    allowed = 3 * sigma + 0.01 * np.concatenate([width, true[3:]])
    assert (np.abs(found - exact) < allowed).all()


def test_where_the_input_acts_is_read():
    assert read_input_dof("2:-tz") == (2, -3)
    assert read_input_dof("12:yaw") == (12, 6)
    assert read_input_dof("3:+roll") == (3, 4)
    for text in ("tz", "2:x", "-1:tx", "2:--tz"):
        with pytest.raises(InputError, match="allowed: NODE:AXIS"):
            read_input_dof(text)


def test_the_input_has_the_type_of_its_unit():
    for column, expected in {
        "force_n": (13, "N", 1.0),
        "force_kn": (13, "N", 1e3),
        "torque_n_m": (13, "N m", 1.0),
        "base_m_s2": (12, "m/s^2", 1.0),
        "current_a": (0, "NONE", 1.0),
        "force": (0, "NONE", 1.0),
    }.items():
        assert input_type(column) == expected, column
