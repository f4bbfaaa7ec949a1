"""What a command says beside its result: exit status 1, estimates, older spellings, hints."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import facets
from facets.core import READING_COLUMNS, STATE_COLUMNS


@pytest.fixture
def run(run_in_process):
    return run_in_process


DARK = "extends: paper\nsensor: {beam: {power_mw: 1.0e-300}}\nmotions: {x-steps: {steps: 3}}\n"


def test_a_simulation_of_which_nothing_is_solved_is_a_finding(run, tmp_path):
    (tmp_path / "dark.yaml").write_text(DARK)
    status, out, _ = run("simulate", "dark.yaml", "--motion", "x-steps", "--folder", "out")
    assert status == 1
    assert "converged" not in out
    assert "nan" not in out
    assert (tmp_path / "out" / "poses.csv").exists()
    assert run("solve", "paper", "out/readings.csv", "-o", "p.csv")[0] == 1


def poses_of_estimates(path, beam):
    """A table of poses with its readings, as `replay -o` writes it: the beam's place estimated."""
    state = np.random.default_rng(1).uniform(-1, 1, (20, 8))
    state *= [0.02, 0.02, 0.5, 1e-3, 1e-3, 1e-3, 0.01, 0.01]
    reading = facets.readings(facets.Sensor(), state)
    found = facets.solve(facets.Sensor(), reading, beam=beam)
    columns = dict(zip(READING_COLUMNS, reading.T, strict=True))
    columns |= {name: found.state[:, i] for i, name in enumerate(STATE_COLUMNS)}
    columns |= {f"u_{name}": found.uncertainty[:, i] for i, name in enumerate(STATE_COLUMNS)}
    factor = [1, 1, 1, 1e3, 1e3, 1e3]
    columns |= {f"ref_{n}": factor[i] * state[:, i] for i, n in enumerate(STATE_COLUMNS[:6])}
    pd.DataFrame(columns).to_csv(path, index=False)


def test_an_estimated_beam_is_not_taken_for_a_known_one(run, tmp_path):
    poses_of_estimates(tmp_path / "first.csv", "free")
    for words in (
        ("solve", "paper", "first.csv", "-o", "p.csv", "--beam", "known"),
        ("solve", "paper", "first.csv", "-o", "p.csv", "--beam", "prior"),
        ("calibrate", "paper", "first.csv", "-o", "c.yaml"),
    ):
        status, _, err = run(*words)
        assert status == 2
        assert "first.csv:2: bx_mm is an estimate (u_bx_mm beside it is" in err
    assert "still" in err
    assert [path.name for path in tmp_path.iterdir()] == ["first.csv"]
    assert run("solve", "paper", "first.csv", "-o", "p.csv", "--beam", "free")[0] == 0


def test_a_beam_that_was_known_still_is(run, tmp_path):
    poses_of_estimates(tmp_path / "first.csv", "known")
    status, out, err = run("solve", "paper", "first.csv", "-o", "p.csv", "--beam", "known")
    assert "is an estimate" not in err
    assert "20 rows" in out or status in (0, 1)


def test_a_beam_that_stood_still_is_said_so_in_the_configuration(tmp_path):
    from dataclasses import replace

    from facets.calibration import read

    poses_of_estimates(tmp_path / "first.csv", "free")
    (tmp_path / "still.yaml").write_text("extends: paper\ncalibrate: {beam: still}\n")
    settings = facets.load(tmp_path / "still.yaml").calibrate
    assert (read(tmp_path / "first.csv", settings).beam == 0).all()
    with pytest.raises(facets.core.errors.InputError, match="is an estimate"):
        read(tmp_path / "first.csv", replace(settings, beam="given"))


def test_a_fit_that_noise_can_not_make_is_a_finding(run, tmp_path):
    readings = facets.readings(facets.load("rig").sensor, np.zeros((10, 8)))
    table = dict(zip(READING_COLUMNS, readings.T, strict=True))
    pd.DataFrame(table).to_csv(tmp_path / "r.csv", index=False)
    status, out, _ = run("solve", "paper", "r.csv", "-o", "p.csv", "--beam", "known")
    assert "10 of 10 rows solved" in out
    assert "10 of 10 poses have a residual beyond chance" in out
    assert "A wrong geometry in the configuration" in " ".join(out.split())
    assert status == 1
    assert run("solve", "rig", "r.csv", "-o", "q.csv", "--beam", "known")[0] == 0


def test_a_shipped_name_that_is_also_a_file_here_is_told(run, tmp_path):
    (tmp_path / "rig.yaml").write_text("extends: paper\n")
    assert "the shipped configuration is used, not ./rig.yaml" in run("config", "show", "rig")[2]
    assert run("config", "show", "rig.yaml")[2] == ""


def test_a_place_without_light_names_key_and_amount(run):
    status, _, err = run(
        "range-map", "paper", "--axes", "tx,ty", "--at", "tx_mm=3", "--folder", "out"
    )
    assert status == 2
    assert "µW, and range.snr 810 asks for 32.4 µW" in err


def test_states_without_number_are_estimated_and_refused(run):
    status, _, err = run("jacobian", "paper", "--states", "100000000000", "--folder", "out")
    assert status == 2
    assert "allowed: up to 1,073,741,824; these would take about" in err


def test_a_box_without_light_is_an_error(run, tmp_path):
    words = ("jacobian", "paper", "--box", "tx_mm=8000:9000", "--states", "100", "--folder", "out")
    status, _, err = run(*words)
    assert status == 2
    assert "gives every detector a reading" in err
    assert not (tmp_path / "out").exists()


def test_one_state_makes_no_picture(run, tmp_path):
    words = (
        "jacobian",
        "paper",
        "--states",
        "1",
        "--no-search-worst",
        "--folder",
        "out",
        "--box",
        "tz_mm=1",
    )
    status, out, _ = run(*words)
    assert status == 0
    assert "No picture was drawn: it needs at least two states" in out
    assert not (tmp_path / "out" / "jacobian.png").exists()
