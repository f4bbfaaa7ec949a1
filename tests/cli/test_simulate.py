"""`facets simulate` and `facets solve`, as a user runs them."""

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import command

import facets
from facets.core import READING_COLUMNS


def poses(path: Path) -> pd.DataFrame:
    return pd.read_csv(path, comment="#")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Where the paper's sensor was simulated."""
    folder = tmp_path_factory.mktemp("bench")
    done = command("simulate", "paper", "--motion", "yaw-sweep", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "401 converged" in done.stdout
    return folder


def test_simulate_writes_readings_poses_picture_and_record(folder):
    results = folder / "results" / "paper"
    names = ["motion.png", "poses.csv", "readings.csv", "ro-crate-metadata.json", "run.yaml"]
    assert sorted(file.name for file in results.iterdir()) == names
    assert (results / "motion.png").stat().st_size > 50_000
    record = (results / "run.yaml").read_text()
    for key in ("config_sha256", "seed", "command: facets simulate paper", "resolved"):
        assert key in record
    table = poses(results / "poses.csv")
    assert len(table) == 401
    assert np.abs(table.yaw_mrad - table.true_yaw_mrad).max() < 0.05


def test_its_readings_solve_to_its_poses_in_a_table_or_sent_on(folder):
    words = ("solve", "paper", "results/paper/readings.csv")
    done = command(*words, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "401 of 401 rows solved: results/paper-poses.csv" in done.stdout
    first, again = (
        poses(folder / "results/paper/poses.csv"),
        poses(folder / "results/paper-poses.csv"),
    )
    for name in ("time_s", "tx_mm", "yaw_mrad", "u_tx_mm", "residual"):
        np.testing.assert_array_equal(first[name], again[name])
    assert (again.used == "abc").all()
    sent = command(*words, "-o", "-", cwd=folder)
    assert "401 of 401 rows solved: to standard output" in sent.stderr
    (folder / "sent.csv").write_text(sent.stdout)
    pd.testing.assert_frame_equal(again, poses(folder / "sent.csv"))


def test_old_results_are_kept(folder):
    before = (folder / "results/paper/poses.csv").read_text()
    done = command("simulate", "paper", cwd=folder)
    assert done.returncode == 2
    assert "exist already; use --force to overwrite" in done.stderr
    assert (folder / "results/paper/poses.csv").read_text() == before


@pytest.mark.parametrize("kind", ["parquet", "h5"])
def test_other_tables_and_svg_and_no_noise(kind, tmp_path):
    line = "simulate paper --motion x-steps --folder r --no-noise --seed 7 --plot svg --table"
    done = command(*line.split(), kind, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    table = facets.read_table(tmp_path / "r" / f"poses.{kind}")
    head = table.attrs
    assert hashlib.sha256(head["configuration"].encode()).hexdigest() == head["config_sha256"]
    assert np.abs(table.tx_mm - table.true_tx_mm).max() < 1e-10
    assert "<svg" in (tmp_path / "r" / "motion.svg").read_text()[:1000]
    again = ("solve", "paper", f"r/readings.{kind}", "-o", f"p.{kind}", "--beam", "known")
    assert command(*again, cwd=tmp_path).returncode == 0
    known = facets.read_table(tmp_path / f"p.{kind}")
    assert (known.u_bx_mm == 0).all()
    assert (known.u_tx_mm < table.u_tx_mm / 5).all()


def write_readings(path: Path) -> None:
    """Five rows: good, unparsable, without detector B, good, torn."""
    row = ",".join(repr(float(x)) for x in facets.readings(facets.Sensor(), np.zeros(8)))
    cells = row.split(",")
    without_b = ",".join([*cells[:3], "", "nan", "", *cells[6:]])
    names = ",".join(READING_COLUMNS)
    rows = [row, "here" + row, without_b, row, ",".join(cells[:4])]
    path.write_text(f"{names}\n" + "\n".join(rows))


def test_bad_rows_are_counted_and_keep_their_place(tmp_path):
    write_readings(tmp_path / "readings.csv")
    words = ("solve", "paper", "readings.csv", "-o", "poses.csv")
    done = command(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "2 of 5 rows solved" in done.stdout
    assert "2 unparsable: lines 3, 6" in done.stdout
    assert "a wrong position of a spot by any amount" in " ".join(done.stdout.split())
    table = poses(tmp_path / "poses.csv")
    expected = ["converged", "unparsable", "non finite", "converged", "unparsable"]
    assert table.status.tolist() == expected
    assert table.tx_mm.isna().tolist() == [False, True, True, False, True]
    assert table.used.fillna("").tolist() == ["abc", "", "ac", "abc", ""]
    known = command(*words, "--beam", "known", "--force", cwd=tmp_path).stdout
    assert "2 of 5 rows solved" in known
    assert "1 unchecked: row 3\n" in known
    assert "Rows without a redundant reading: 1. A detector gives no usable" in known
    assert "(PSD B in 1)" in " ".join(known.split())
    assert poses(tmp_path / "poses.csv").status[2] == "unchecked"
    accepted = command(
        *words, "--beam", "known", "--accept-unchecked", "--force", cwd=tmp_path
    ).stdout
    assert "3 of 5 rows solved" in accepted
    assert "Poses without a redundant reading: 1. Nothing checks them" in accepted


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("solve paper none.csv -o p.csv", "none.csv: no such file"),
        ("solve paper names.csv -o p.csv", "missing columns: psi_a_mm"),
        ("solve paper empty.csv -o p.csv", "no rows"),
        ("solve paper readings.csv -o p.txt", "ends in .csv, .csv.gz, .parquet or .h5"),
        ("solve paper readings.csv -o readings.csv --force", "made from it"),
        ("solve paper readings.csv -o p.csv --beam fixed", "fixed"),
        (
            "solve paper readings.csv -o p.csv --method paper --beam known",
            'method="paper" has the beam "free"',
        ),
        ("simulate paper --motion jump", "no motion jump"),
        ("simulate none.yaml", "none.yaml"),
    ],
)
def test_bad_input_gets_a_message_and_leaves_nothing(tmp_path, line, message):
    write_readings(tmp_path / "readings.csv")
    (tmp_path / "names.csv").write_text("psi,zeta\n1,2\n")
    (tmp_path / "empty.csv").write_text(",".join(READING_COLUMNS) + "\n")
    before = sorted(file.name for file in tmp_path.iterdir())
    done = command(*line.split(), cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == before


def test_objects_and_zeros_are_columns_that_cover_the_truth(folder):
    """`simulate` and `solve` give the same columns of the object and of its displacements."""
    words = ("--point", "-10,0,50", "--zero", "row:201", "--covariance")
    done = command("simulate", "paper", "--motion", "yaw-sweep", "-d", "moved", *words, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "yaw-sweep: the object" in done.stdout
    table = poses(folder / "moved" / "poses.csv")
    for prefix in ("object_", "displacement_"):
        for name in ("tx_mm", "ty_mm", "yaw_mrad"):
            error = table[f"{prefix}{name}"] - table[f"true_{prefix}{name}"]
            inside = error.abs() < 1.96 * table[f"u_{prefix}{name}"]
            assert inside.drop(index=200).mean() > 0.85
    head = (folder / "moved" / "poses.csv").read_text().splitlines()[:9]
    assert any(line.startswith("# object: point -10, 0, 50 mm, orientation 0") for line in head)
    assert any(line.startswith("# zero: row 201, 1 sample: tx_mm") for line in head)
    assert "row 201, 1 sample:" in " ".join((folder / "moved" / "run.yaml").read_text().split())
    readings = str(folder / "moved" / "readings.csv")
    done = command("solve", "paper", readings, "-o", "moved.csv", *words, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "\n  zero: row 201, 1 sample: tx_mm" in done.stdout
    again = poses(folder / "moved.csv")
    names = [name for name in again if "object" in name or "displacement" in name]
    assert len(names) == 4 * 6 + 2 * 21
    np.testing.assert_array_equal(again[names], table[names])
