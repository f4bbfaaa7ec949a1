"""`facets jacobian` end to end."""

from __future__ import annotations

import json

import pytest
from commands import command
from facets.experiments import check_certificate


@pytest.mark.slow
def test_samples_searches_and_proves(tmp_path):
    box = "tx_mm=1,ty_mm=1,tz_mm=1,roll_mrad=3,pitch_mrad=3,yaw_mrad=3,offset_x_mm=0.05"
    result = command(
        "jacobian", "fig4", "--box", box, "--states", "3000", "--certify",
        "-d", "out", cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "3000 above zero, 0 below" in result.stdout
    assert "proved: no two of them have the same readings" in result.stdout
    names = "jacobian.png density.csv run.yaml ro-crate-metadata.json certificate.json"
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(names.split())
    assert json.loads((tmp_path / "out" / "certificate.json").read_text())["unique"]


@pytest.mark.slow
def test_what_is_not_proved_shows_in_the_exit_status(tmp_path):
    box = (
        "tx_mm=2,ty_mm=5,tz_mm=3,roll_mrad=6,pitch_mrad=3,yaw_mrad=20,"
        "offset_x_mm=0.2,offset_y_mm=0.2"
    )  # beyond the range, which ends at singular poses
    result = command(
        "jacobian", "singular", "--states", "2000", "--certify", "--box", box, "-d", "out",
        cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 1, result.stderr
    assert "both signs" in result.stdout
    assert "two states with the same readings:" in result.stdout
    assert "not proved: " in result.stdout
    assert "counterexample" in result.stdout


@pytest.mark.slow
def test_a_box_is_proved_for_every_sensor_within_tolerances(tmp_path):
    result = command(
        "jacobian", "paper", "--box", "tx_mm=0.05,tz_mm=0.05", "--states", "100", "--certify",
        "--tolerances", "1", "--no-search-worst", "-d", "out", cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert "taken as exact: beam.power" in result.stdout.replace("\n", " ").replace("  ", " ")
    assert check_certificate.check(tmp_path / "out" / "certificate.json").margin > 0


@pytest.mark.slow
def test_of_a_box_that_is_mostly_dark_no_sign_is_claimed(tmp_path):
    done = command("jacobian", "paper", "--box", "tx_mm=2000", "--states", "2000", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "both signs" not in done.stdout
    assert "the survey allows no statement on the box, because " in done.stdout
