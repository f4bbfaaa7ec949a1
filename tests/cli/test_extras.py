"""A package that an extra brings and that is missing is told before any work, with its extra."""

from __future__ import annotations

import sys
import tomllib

import pytest
from chains import GIVEN, NEEDS
from facets.cli import run_app
from installed import ROOT
from packaging.requirements import Requirement
from recorded import record

from facets.core import extras

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


@pytest.mark.parametrize(("package", "words"), NEEDS)
def test_a_missing_package_is_told_before_the_work(package, words, tmp_path, monkeypatch, capsys):
    if words[0] == "replay":
        record(tmp_path / "rec")
        monkeypatch.setattr("facets.live.playback.replay", None)  # no work begins
    for name, text in GIVEN.items():
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(sys, "argv", ["facets", *words])
    for name in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    assert run_app() == 2
    said = capsys.readouterr().err
    assert f'needs {package}: pip install "facets-6dof[{extras.EXTRAS[package]}]"' in said
    assert sorted(tmp_path.rglob("*")) == before


def test_every_extra_is_one_that_the_package_has():
    known = PROJECT["optional-dependencies"]
    for package, extra in extras.EXTRAS.items():
        name = "python-flint" if package == "flint" else package
        assert any(one.startswith(name) for one in known[extra]), package


def test_all_is_every_extra_that_needs_no_driver_of_a_maker():
    known = PROJECT["optional-dependencies"]
    (everything,) = (Requirement(text) for text in known["all"])
    assert everything.extras == known.keys() - {"all", "ni", "stages", "thorlabs"}
