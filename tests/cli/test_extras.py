"""A package that an extra brings and that is missing is told before any work, with its extra."""

from __future__ import annotations

import sys

import pytest
from facets.cli import run_app
from recorded import record

from facets.core import extras


@pytest.mark.parametrize(
    ("package", "words"),
    [
        ("mcap", ["replay", "rec", "-o", "x.mcap"]),
        ("h5py", ["replay", "rec", "-o", "x.h5"]),
        ("h5py", ["simulate", "paper", "--table", "h5", "-d", "y"]),
        ("h5py", ["solve", "paper", "readings.csv", "-o", "x.h5"]),
        ("nptdms", ["solve", "paper", "readings.tdms"]),
        ("pylsl", ["replay", "rec", "--publish", "lsl:x"]),
        ("aiohttp", ["replay", "rec", "--web", "0"]),
        ("pylsl", ["acquire", "bench", "--port", "file:board.bin", "--publish", "lsl:x"]),
        ("aiohttp", ["acquire", "bench", "--port", "file:board.bin", "--web", "0"]),
        ("nidaqmx", ["acquire", "bench", "--port", "ni:Dev1/ai0:11"]),
        ("pylablib", ["acquire", "bench", "--port", "thorlabs:1,2,3"]),
        ("openpyxl", ["optimize", "layout", "-o", "x.yaml", "--sheets", "x.xlsx"]),
        ("plotly", ["explore", "layout", "--report", "x.html"]),
        ("pyvista", ["render", "paper", "-o", "x.png"]),
        ("pyvista", ["render", "paper", "-o", "x.gltf"]),
        ("imageio", ["render", "paper", "--motion", "multi-axis", "-o", "x.mp4"]),
        ("casadi", ["optimize", "layout", "-o", "x.yaml"]),
        ("casadi", ["explore", "layout", "--front", "-d", "y"]),
        ("distributed", ["explore", "layout", "--scheduler", "tcp://127.0.0.1:1"]),
    ],
)
def test_a_missing_package_is_told_before_the_work(package, words, tmp_path, monkeypatch, capsys):
    if words[0] == "replay":
        record(tmp_path / "rec")
        monkeypatch.setattr("facets.live.playback.replay", None)  # no work begins
    if words[0] == "acquire":
        (tmp_path / "board.bin").touch()
    if words[0] == "solve":
        (tmp_path / words[2]).write_text("TDSm" if words[2].endswith("tdms") else "psi_a_mm\n1\n")
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(sys, "argv", ["facets", *words])
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    assert run_app() == 2
    said = capsys.readouterr().err
    assert f"needs {package}: pip install 'facets-6dof[{extras.EXTRAS[package]}]'" in said
    assert sorted(tmp_path.rglob("*")) == before


def test_every_extra_is_one_that_the_package_has():
    import tomllib
    from pathlib import Path

    project = Path(__file__).parents[2] / "pyproject.toml"
    known = tomllib.loads(project.read_text())["project"]["optional-dependencies"]
    for package, extra in extras.EXTRAS.items():
        assert any(one.startswith(package) for one in known[extra]), package
