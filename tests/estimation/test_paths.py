"""The same samples give the same poses on all ways: see `tests/helpers/sample_paths.py`."""

from __future__ import annotations

import re

import numpy as np
import pytest
from sample_paths import (
    FIRST,
    RUN_PATHS,
    ZERO,
    make_bench,
    simulate,
    solve_table,
    write_config,
)

pytestmark = pytest.mark.slow
#: What a user is told. A table has rows, and a run samples.
TOLD = {
    "misfits": r"\d+ of \d+ poses have a residual beyond chance .*?; the median",
    "unchecked poses": r"Poses without a redundant reading: \d+",
    "unseen errors": r"A wrong power then shifts the pose by .*?; a wrong position .*?\.",
    "missing temperatures": r"\d+ (rows|samples) have no value of temperature_c",
    "the zero": r"zero: .*? \d+ samples?: ",
}
#: Where ways are known to differ from a table: it does not tell why a reading is not finite, and
#: the displacements of a stream begin when it has measured its zero.
STREAM = {"status", "late displacements"}
KNOWN = {
    # a replay has them
    "run": STREAM | {"no used", "no power_mw", "no time_s", "no misfit"},
    "replay": STREAM | {"no time_s"},
    # a row without a pose has no place of the beam, either
    "table of a replay": {"used"},
    "loop in Python": STREAM | {"no time_s"} | {f"no {what} told" for what in TOLD},
    "simulation": set(),
}


def told(result, what):
    match = re.search(TOLD[what], result.said)
    return match.group().replace("rows", "samples") if match else ""


def differences(result, expected):
    """In what a way's result is another than that of a table."""
    found = set()
    for name, theirs in expected.poses.items():
        is_late = "displacement" in name
        if name not in result.poses:
            kind = "covariances" if name.startswith("cov_") else name
            found.add(f"no {'displacements' if is_late else kind}")
            continue
        ours = result.poses[name]
        if theirs.dtype.kind not in "fi":
            if (ours.fillna("") != theirs.fillna("")).any():
                found.add(name)
            continue
        rounding = 1e-8 if name == "residual" else 1e-12
        same = np.isclose(ours, theirs, rtol=1e-9, atol=rounding, equal_nan=True)
        if not same.all():
            begins = is_late and np.isnan(ours[~same]).all() and same[-250:].all()
            found.add("late displacements" if begins else name)
    return found | {
        f"no {what} told" for what in TOLD if told(result, what) != told(expected, what)
    }


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A folder with a board's samples, and what their table gives."""
    folder = tmp_path_factory.mktemp("run")
    make_bench(folder)
    return folder, solve_table(folder, *ZERO)


@pytest.mark.parametrize("name", RUN_PATHS)
def test_a_run_s_samples_give_the_same_poses_on_all_ways(run, name):
    folder, expected = run
    assert all(told(expected, what) for what in TOLD)
    assert {"converged", "non finite"} == set(expected.poses.status)
    assert differences(RUN_PATHS[name](folder), expected) == KNOWN[name]


def test_a_simulation_s_samples_give_the_same_poses_as_their_table(tmp_path):
    write_config(tmp_path, follows_temperature=False)
    result = simulate(tmp_path)
    expected = solve_table(tmp_path, *FIRST, readings="sim/readings.csv")
    assert differences(result, expected) == KNOWN["simulation"]
