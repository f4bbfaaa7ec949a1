"""`facets bench`: that its contenders compute the same, and that its table says so."""

import time
from importlib.resources import files

import numpy as np
import pandas as pd
import pytest
from commands import command

from facets.bench import Contender, cpu_seconds, has_compiler, pose_ways, reading_ways, slower_rows

EXPORTED_C = "the exported C (gcc -O3 -march=native)"


@pytest.mark.slow
def test_errors_are_those_of_rounding(tmp_path):
    """No times: machines are noisy. 1e-12 mm is 300 mm's rounding times a dozen steps."""
    done = command("bench", "--quick", "-d", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert ("gcc is not installed" in done.stdout) == (not has_compiler())
    text = (tmp_path / "out/bench.csv").read_text()
    assert all(f"# {name}: " in text for name in ("processor", "numpy", "seed", "command"))
    table = pd.read_csv(tmp_path / "out/bench.csv", comment="#").set_index(["task", "way"])
    assert (table.us > 0).all()
    assert len(table.loc["files"]) == 4
    assert ((table.to_c == 1).sum() == 2) == has_compiler()
    assert (table["to_numpy"] == 1).sum() == 2
    readings = table.loc["readings"].error_mm
    assert (readings[readings.index.str.startswith("facets")] < 5.5e-13).all()
    assert readings["Gauss-Legendre of 12 nodes (NumPy)"] < 1e-6
    assert readings["dblquad (as the paper)"] < 1e-10
    poses = table.loc["poses"]
    exact = poses[poses.index.str.startswith("facets") | (poses.index == EXPORTED_C)]
    assert len(exact) == 5 + has_compiler()
    assert (exact.error_mm < 1e-10).all()
    assert (exact.error_rad < 1e-12).all()
    assert (poses.error_mm < 1e-8).all()


def test_without_a_compiler_the_exported_c_is_left_out(monkeypatch):
    assert EXPORTED_C in [way.name for way in pose_ways(5, 1)] or not has_compiler()
    monkeypatch.setattr("facets.bench.table.has_compiler", lambda: False)
    for ways in (reading_ways(5, 1), pose_ways(5, 1)):
        assert EXPORTED_C not in [way.name for way in ways]


def test_slow_contenders_run_once_and_fast_ones_every_round_by_processor_time(monkeypatch):
    clock, calls = [0.0], {"slow": 0, "fast": 0}
    monkeypatch.setattr(time, "process_time", lambda: clock[0])

    def contender(name, seconds):
        def work(rows):
            clock[0] += seconds[calls[name] % len(seconds)]
            calls[name] += 1

        return Contender(name, work, 1)

    contenders = [contender("slow", [2.1]), contender("fast", [1.5, 0.5, 0.7, 0.6])]
    (slow, _), (fast, spread) = cpu_seconds(contenders, np.zeros((1, 17)), 3)
    assert calls == {"slow": 1 + 1, "fast": 1 + 3}  # the first one compiles
    assert (slow, fast, spread) == pytest.approx((2.1, 0.5, 0.2))


def test_rows_that_are_slower_than_stored_by_more_than_their_error_bars_are_named(monkeypatch):
    monkeypatch.setattr("facets.bench.table.has_compiler", lambda: True)
    with (files("facets.bench") / "stored.csv").open() as file:
        stored = pd.read_csv(file, comment="#")
    assert list(slower_rows(stored.to_dict("records"))) == []
    stored.loc[3, "to_c"] *= 1.26 + 2 * stored.spread[3]
    (sentence,) = slower_rows(stored.to_dict("records"))
    assert sentence.startswith(f"{stored.task[3]}, {stored.way[3]}: takes 1.")
