"""`facets config`, as a person runs it."""

from __future__ import annotations

import json

from commands import command


def test_check_says_ok_and_what_the_sensor_is(tmp_path):
    result = command("config", "check", "paper", cwd=tmp_path)
    assert result.returncode == 0
    assert result.stdout.startswith("ok  paper: 0.3 mW, beam 0.85 mm, facets 45 deg, PSDs ")
    assert result.stderr == ""


def test_check_reports_every_file_and_exits_2_without_traceback(tmp_path):
    (tmp_path / "bad.yaml").write_text("sensor:\n  beam: {power: 1}\nsolve: {beam: x}\n")
    result = command("config", "check", "paper", "bad.yaml", "nowhere.yaml", "skewed", cwd=tmp_path)
    assert result.returncode == 2
    assert [line.split(":")[0] for line in result.stdout.splitlines()] == [
        "ok  paper",
        "ok  skewed",
    ]
    assert "Traceback" not in result.stderr
    first, second, third = result.stderr.splitlines()
    assert first.startswith("error: bad.yaml:2: sensor.beam.power: unknown key")
    assert second.startswith("       bad.yaml:3: solve.beam: ")
    assert third.startswith("error: nowhere.yaml: no such file")
    result = command("config", "show", "bad.yaml", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr.startswith("error: bad.yaml:2: sensor.beam.power: ")


def test_show_prints_a_configuration_that_checks_with_the_same_sum(tmp_path):
    shown = command("config", "show", "skewed", cwd=tmp_path)
    assert shown.returncode == 0
    (tmp_path / "again.yaml").write_text(shown.stdout, encoding="utf-8")
    sums = [
        command("config", "check", name, cwd=tmp_path).stdout.rpartition("sha256 ")[2]
        for name in ("skewed", "again.yaml")
    ]
    assert sums[0] == sums[1] != ""


def test_schema_is_json(tmp_path):
    printed = json.loads(command("config", "schema", cwd=tmp_path).stdout)
    names = "extends sensor object motions simulate solve range acquire stage optimize calibrate"
    assert set(printed["properties"]) == set(names.split())


def test_list_names_what_is_shipped(tmp_path):
    lines = command("config", "list", cwd=tmp_path).stdout.splitlines()
    assert [line.split(":")[0] for line in lines] == [
        "bench", "bench-drift", "bench-light", "catalogue", "fig4", "layout", "market", "paper",
        "parts", "rig", "shaker", "singular", "skewed", "stage-test", "tilt-stage",
    ]  # fmt: skip
