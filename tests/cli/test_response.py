"""`facets response`: from a table and from recorded bytes to responses, and what it refuses."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest

import facets
from facets.core import STATE_COLUMNS
from facets.files import run_record
from facets.live import Bench, BenchSetup, Block, Pipeline, Recording
from facets.simulation import receptance

MINE = """extends: bench
acquire: {channels: [{name: force, unit: N}]}
motions:
  shaken:
    kind: vibration
    modes:
      bounce: {frequency_hz: 60, damping_percent: 5, per_newton: {tz_um: 20, pitch_urad: 30}}
    from_hz: 5
    to_hz: 300
    samples: 12000
"""


@pytest.fixture
def run(tmp_path, run_in_process):
    """Runs a command in this process, in a folder of its own: status, output, errors."""
    (tmp_path / "mine.yaml").write_text(MINE)
    return run_in_process


def record(folder):
    """What the virtual bench's board sends of the shaken body, without a port or a clock."""
    config = facets.load("mine.yaml")
    bench = Bench(BenchSetup(config, "shaken", 1000.0), folder.parent / "ports")
    recording = Recording(folder, run_record(config, None, 0.0, {}), config.resolved)
    pipeline = Pipeline(config)
    bench.begin = 0.0
    try:
        for first in range(0, 12_000, 500):
            if first == 4000:  # half a second is lost
                continue
            seq = np.arange(first, first + 500, dtype=np.uint32)
            states = bench.mirror.interpolate(seq / 1000)
            bench.board.switch_on(0.0)
            data = bench.board.encode(bench.board.sample(states, seq, seq / 1000, 0.0))
            recording.add_block(Block(data, (first + 500) / 1000, None))
            recording.add_poses(pipeline.feed(data, (first + 500) / 1000))
    finally:
        bench.end()
        recording.close()
    return config


@pytest.mark.slow
def test_a_recording_gives_the_responses_at_the_point_of_interest(run, tmp_path):
    config = record(tmp_path / "rec")
    _, _, refusal = run("response", "rec", "--input", "force_kn")
    assert "rec: has no auxiliary channel with the column force_kn; it has: force_n" in refusal
    status, out, err = run("response", "rec", "--input", "force_n", "--point", "0,0,100",
                           "--resolution-hz", "1", "--uff", "body.uff")  # fmt: skip
    assert (status, err) == (0, "")
    assert "11,500 rows at 1000 Hz: " in out
    assert "segments were left out, because gaps cut them: 500 samples were lost or not" in out
    assert "point 0, 0, 100 mm" in out
    assert "results/rec-response/: response.csv, response.png\nbody.uff" in out
    assert (tmp_path / "body.uff").exists()
    table = pd.read_csv(tmp_path / "results" / "rec-response" / "response.csv", comment="#")
    table = table[table["excited"] == 1]
    true = receptance(config.motions["shaken"], table["frequency_hz"].to_numpy())
    true[:, 0] += 100 * true[:, 4]
    for axis, n, scale in (("tx", 0, 1e3), ("tz", 2, 1e3), ("pitch", 4, 1e6)):
        unit = "urad" if n > 2 else "um"
        h1 = table[f"h1_{axis}_real_{unit}"] + 1j * table[f"h1_{axis}_imag_{unit}"]
        apart = np.abs(h1 - scale * true[:, n]) / np.abs(scale * true[:, n])
        lines = table["frequency_hz"].between(10, 150)
        assert apart[lines].median() < 0.05
    lowest = table["noise_tx_um"].median()
    assert np.abs(h1.iloc[0]) > 20 * lowest


@pytest.mark.slow
def test_a_table_needs_a_configuration_times_and_the_input(run, tmp_path):
    assert run("simulate", "mine.yaml", "--motion", "shaken", "-d", "sim")[0] == 0
    words = ("response", "sim/poses.csv", "--config", "mine.yaml")
    status, out, _ = run(*words, "--input", "force_n", "--correct-bandwidth", "-d", "out")
    assert status == 0
    assert re.search(r"\n +(59|60)\.\d+ +tz ", out)
    assert "; this is corrected." in out
    for more, text in (
        (("--input", "force"), "missing columns: force; did you mean 'force_n'?"),
        (("--input", "force_n", "-d", "out"), "out/response.csv, out/response.png: exist already"),
        (("--input", "force_n", "--point", "1,2"), "--point is '1,2'; allowed: three numbers"),
        (("--input", "force_n", "--uff", "a.txt"), "a.txt: a universal file's name ends in .uff"),
        (("--input", "force_n", "--input-dof", "z"), "--input-dof is 'z'; allowed: NODE:AXIS"),
        (("--input", "force_n", "--resolution-hz", "400"), "allowed: up to 15.62 Hz"),
        (("--input", "motion"), "column motion holds 'shaken', not a number"),
    ):
        status, _, err = run(*words, *more)
        assert (status, text in err) == (2, True), err
    status, _, err = run("response", "sim/poses.csv", "--input", "force_n")
    assert (status, "a table needs --config CONFIG" in err) == (2, True)
    table = pd.read_csv("sim/poses.csv", comment="#").drop(columns="time_s")
    table.to_csv("timeless.csv", index=False)
    status, _, err = run("response", "timeless.csv", "--input", "force_n", "--config", "paper")
    assert (status, "timeless.csv: missing columns: time_s or board_us" in err) == (2, True)


def noise_table(*inputs):
    """A table at 1 kHz of a body that does not answer to its inputs, which are white noise."""
    noise = np.random.default_rng(1).standard_normal((4000, len(inputs) + 6))
    table = pd.DataFrame(noise, columns=[*inputs, *STATE_COLUMNS[:6]])
    table[[*STATE_COLUMNS[:6]]] *= 1e-4
    return table.assign(time_s=np.arange(4000) / 1000)


def test_a_body_that_does_not_answer_is_a_finding(run, tmp_path):
    table = noise_table("force_n")
    table.loc[1500, "force_n"] = table.loc[1501, "tz_mm"] = 1e200
    table.to_csv("still.csv", index=False)
    status, out, _ = run("response", "still.csv", "--input", "force_n", "--config", "paper",
                         "--style", "dark", "--plot", "svg")  # fmt: skip
    assert status == 1
    assert "2 rows have no pose or no input" in out
    assert "No peak stands out of its surroundings" in out
    assert "No response beyond chance: tx, ty, tz, roll, pitch, yaw. What is drawn is" in out
    drawn = (tmp_path / "results" / "still-response" / "response.svg").read_text()
    assert "sensor's noise alone (95 %)" in drawn
    assert "low pass of the electronics" in drawn


def test_each_of_two_inputs_has_its_response_in_the_form_asked_for(run, tmp_path):
    table = noise_table("push_n", "pull_n")
    table["tz_mm"] += 1e-2 * table["push_n"] + 2e-2 * table["pull_n"]
    table.to_csv("it.csv", index=False)
    words = ("response", "it.csv", "--config", "paper", "--input", "push_n", "--input", "pull_n")
    more = (
        "--form",
        "accelerance",
        "--uff",
        "it.uff",
        "--input-dof",
        "2:tz",
        "--input-dof",
        "3:-tz",
    )
    status, out, err = run(*words, *more, "-d", "out")
    assert (status, err) == (0, "")
    assert "pull_n, with the other inputs' contributions removed:" in out
    for name, size in (("push_n", 1e-5), ("pull_n", 2e-5)):
        table = pd.read_csv(f"out/response-{name}.csv", comment="#")
        h1 = np.hypot(table["h1_tz_real_m_s2"], table["h1_tz_imag_m_s2"])
        turn = 2 * np.pi * table["frequency_hz"]
        assert (h1 / turn**2 / size).median() == pytest.approx(1, rel=0.01)
        assert table["coherence_tz"].median() > 0.99
        assert table["multiple_coherence_tz"].median() > 0.999
        assert (tmp_path / "out" / f"response-{name}.png").exists()
    for more, text in (
        (("--form", "apparent-mass", "--uff", "a.uff"), "give --form receptance, mobility or"),
        (("--input-dof", "2:tz"), "--input-dof is given once and --input twice"),
        (("--input", "push_n"), "push_n is given twice"),
    ):
        status, _, err = run(*words, *more)
        assert (status, text in err) == (2, True), err
    assert run(*words[:-2], "--form", "dynamic-stiffness", "-d", "one")[0] == 0
    table = pd.read_csv("one/response.csv", comment="#")
    assert "multiple_coherence_tz" not in table
    assert np.hypot(
        table["h1_tz_real_per_um"], table["h1_tz_imag_per_um"]
    ).median() == pytest.approx(0.1, rel=0.3)
