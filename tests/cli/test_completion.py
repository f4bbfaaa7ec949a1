"""What shells offer at the tabulator."""

from __future__ import annotations

import pytest
from commands import command


def complete(typed, folder):
    """What fish would be given; the same function answers the other shells."""
    env = {"_FACETS_COMPLETE": "complete_fish", "_TYPER_COMPLETE_FISH_ACTION": "get-args",
           "_TYPER_COMPLETE_ARGS": f"facets {typed}"}  # fmt: skip
    result = command(cwd=folder, env=env)
    assert result.returncode == 0, result.stderr
    return [line.partition("\t")[0] for line in result.stdout.splitlines() if line]


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("solv", ["solve"]),
        ("solve m", ["market", "mine.yaml"]),
        ("solve ./m", ["./mine.yaml"]),
        ("solve a", ["a b/"]),
        ("solve ../no", []),
        ("config check skew", ["skewed"]),
        ("noise rec --config skew", ["skewed"]),
        ("render paper --at tz_mm=1,ya", ["tz_mm=1,yaw_mrad="]),
        ("render paper --at tz_mm=1,tz", []),
        ("calibrate paper --effect spl", ["spline=on", "spline=off", "spline=auto"]),
        ("explore layout --objective cond", ["condition"]),
        ("reproduce fig1", ["fig10", "fig11"]),
        ("simulate nowhere --motion ", []),
        ("simulate mine.yaml --motion multi", ["multi-axis"]),
        ("emulate broken.yaml --motion ", []),
    ],
)
def test_names_are_completed(typed, expected, tmp_path):
    (tmp_path / "mine.yaml").write_text("extends: paper\n")
    (tmp_path / "broken.yaml").write_text("sensor: [")
    (tmp_path / "a b").mkdir()
    (tmp_path / "another.csv").touch()
    assert complete(typed, tmp_path) == expected
