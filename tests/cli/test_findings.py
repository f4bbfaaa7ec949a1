"""What a command says beside its result: exit status 1, estimates, older spellings, hints."""

from __future__ import annotations

import numpy as np
import pandas as pd

import facets
from facets.calibration import read
from facets.core import READING_COLUMNS, STATE_COLUMNS

DARK = "extends: paper\nsensor: {beam: {power_mw: 1.0e-300}}\nmotions: {x-steps: {steps: 3}}\n"


def test_a_simulation_of_which_nothing_is_solved_is_a_finding(run_in_process, tmp_path):
    (tmp_path / "dark.yaml").write_text(DARK)
    status, out, _ = run_in_process(
        "simulate", "dark.yaml", "--motion", "x-steps", "--folder", "out"
    )
    assert status == 1
    assert "converged" not in out
    assert "nan" not in out
    assert (tmp_path / "out" / "poses.csv").exists()
    assert run_in_process("solve", "paper", "out/readings.csv", "-o", "p.csv")[0] == 1


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


def test_an_estimated_beam_is_not_taken_for_a_known_one(run_in_process, tmp_path):
    poses_of_estimates(tmp_path / "first.csv", "free")
    for words in (
        ("solve", "paper", "first.csv", "-o", "p.csv", "--beam", "known"),
        ("solve", "paper", "first.csv", "-o", "p.csv", "--beam", "prior"),
        ("calibrate", "paper", "first.csv", "-o", "c.yaml"),
    ):
        status, _, err = run_in_process(*words)
        assert status == 2
        assert "first.csv:2: bx_mm is an estimate (u_bx_mm is" in err
    assert "still" in err
    assert [path.name for path in tmp_path.iterdir()] == ["first.csv"]
    (tmp_path / "still.yaml").write_text("extends: paper\ncalibrate: {beam: still}\n")
    assert (read(tmp_path / "first.csv", facets.load("still.yaml").calibrate).beam == 0).all()
    assert run_in_process("solve", "paper", "first.csv", "-o", "p.csv", "--beam", "free")[0] == 0
    poses_of_estimates(tmp_path / "known.csv", "known")
    assert run_in_process("solve", "paper", "known.csv", "-o", "q.csv", "--beam", "known")[0] == 0


def test_a_fit_that_noise_can_not_make_is_a_finding(run_in_process, tmp_path):
    readings = facets.readings(facets.load("rig").sensor, np.zeros((10, 8)))
    table = dict(zip(READING_COLUMNS, readings.T, strict=True))
    pd.DataFrame(table).to_csv(tmp_path / "r.csv", index=False)
    status, out, _ = run_in_process("solve", "paper", "r.csv", "-o", "p.csv", "--beam", "known")
    assert "10 of 10 rows solved" in out
    assert "10 of 10 poses have a residual beyond chance" in out
    assert "A wrong geometry in the configuration" in " ".join(out.split())
    assert status == 1
    assert run_in_process("solve", "rig", "r.csv", "-o", "q.csv", "--beam", "known")[0] == 0


def test_a_shipped_name_that_is_also_a_file_here_is_told(run_in_process, tmp_path):
    (tmp_path / "rig.yaml").write_text("extends: paper\n")
    assert (
        "the shipped configuration is used, not ./rig.yaml"
        in run_in_process("config", "show", "rig")[2]
    )
    assert run_in_process("config", "show", "rig.yaml")[2] == ""
