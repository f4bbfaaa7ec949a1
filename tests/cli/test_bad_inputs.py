"""Bad inputs, many of them: never a traceback, nothing half-written, no exit status 0 on failure.

10 of them in `make test`, 150 in `make check`; `FACETS_BAD_INPUTS=1000 pytest
tests/cli/test_bad_inputs.py` tries more.
"""

from __future__ import annotations

import io
import os
import sys

import pytest
from bad_inputs import case
from facets.cli import main

COUNT = int(os.environ.get("FACETS_BAD_INPUTS", "150"))
BUNDLE = 10


def run(words, monkeypatch):
    """A command in this process: its exit status, and what it printed on either stream."""
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "argv", ["facets", *words])
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    with pytest.raises(SystemExit) as end:
        main()
    monkeypatch.undo()
    return end.value.code, out.getvalue(), err.getvalue()


def listing(folder):
    return {path.relative_to(folder) for path in folder.rglob("*")}


def fault_of(number, folder, monkeypatch):
    """What is wrong with the way a case ended; "" where nothing is."""
    folder.mkdir()
    asked = case(number, folder)
    before = listing(folder)
    here = os.getcwd()  # noqa: PTH109
    os.chdir(folder)
    try:
        status, _, err = run(asked.words, monkeypatch)
    except Exception as error:  # a traceback, for a person
        return f"{number}: {asked.what}: {asked.words}: {type(error).__name__}: {error}"
    finally:
        os.chdir(here)
    new = listing(folder) - before
    faults = [
        "status 0, though it is bad" * (status == 0 and asked.certain),
        f"status {status}" * (status not in (0, 1, 2)),
        "no message" * (status != 0 and not err.strip() and status == 2),
        "an error, and status 0" * (status == 0 and "error:" in err.lower()),
        "a traceback" * ("Traceback" in err),
        f"left behind: {sorted(map(str, new))}" * (status == 2 and bool(new)),
        "a hidden file" * any(path.name.startswith(".") for path in new),
    ]
    sentence = "; ".join(filter(None, faults))
    return sentence and f"{number}: {asked.what}: {asked.words}: {sentence}: {err[-300:]}"


@pytest.mark.parametrize(
    "first",
    [pytest.param(n, marks=pytest.mark.slow if n else ()) for n in range(0, COUNT, BUNDLE)],
)
def test_bad_inputs_end_well(first, tmp_path, monkeypatch):
    numbers = range(first, min(first + BUNDLE, COUNT))
    faults = [fault_of(n, tmp_path / str(n), monkeypatch) for n in numbers]
    assert not any(faults), "\n".join(filter(None, faults))
