"""Bad inputs, many of them: never a traceback, nothing half-written, no exit status 0 on failure.

10 of them in `make test`, 150 in `make check`; `FACETS_BAD_INPUTS=1000 pytest
tests/cli/test_bad_inputs.py` tries more.
"""

from __future__ import annotations

import os

import pytest
from bad_inputs import case

COUNT = int(os.environ.get("FACETS_BAD_INPUTS", "150"))


@pytest.mark.parametrize(
    "number",
    [pytest.param(n, marks=pytest.mark.slow if n >= 10 else ()) for n in range(COUNT)],
)
def test_bad_inputs_end_well(number, tmp_path, run_in_process):
    words, is_bad = case(number, tmp_path)
    before = set(tmp_path.rglob("*"))
    status, _, err = run_in_process(*words)
    new = [path.name for path in tmp_path.rglob("*") if path not in before]
    assert status in (0, 1, 2)[is_bad:], words
    assert status != 0 or "error:" not in err.lower()
    assert status != 2 or (err.strip() and not new)
    assert "Traceback" not in err
    assert not any(name.startswith(".") for name in new)
