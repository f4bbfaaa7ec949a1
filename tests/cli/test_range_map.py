"""`facets range-map` and `facets resolution`: what they print and write."""

import pandas as pd
import pytest
from commands import command


@pytest.mark.slow
def test_a_range_map(tmp_path):
    way = ["--track", "--axes", "tx,ty", "--grid", "50", "--inside", "tz", "--table", "parquet"]
    done = command("range-map", "paper", *way, "--plot", "svg", "-d", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "spot leaves the PSD" in done.stdout
    assert "of 2500 grid points differ" in done.stdout
    table = pd.read_parquet(tmp_path / "out/outlines.parquet")
    assert set(table.axis_1) == {"tx_mm"}
    assert table.value_1.max() == pytest.approx(6.8, abs=0.4)
    assert (tmp_path / "out/range.svg").stat().st_size > 10_000


@pytest.mark.slow
def test_a_resolution(tmp_path):
    done = command("resolution", "paper", "-d", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(tmp_path / "out/resolution.csv", comment="#")
    assert len(table) == 4 * 6
    shares = [name for name in table if name.startswith("share_of_")]
    assert table[shares].sum(axis=1).to_numpy() == pytest.approx(1)
