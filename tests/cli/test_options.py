"""What no option can mean is refused, of every command: nothing, the same twice, odd numbers."""

from __future__ import annotations

import pytest
from commands import command
from facets.cli.options import why_meaningless

BAD = [
    (("range-map", "paper", "--at", ""), "'--at': it is empty"),
    (("range-map", "paper", "--at", "tx_mm=1,tx_mm=2"), "--at has tx_mm twice"),
    (("range-map", "paper", "--at", "tx_mm=1_0"), "--at has 'tx_mm=1_0'"),
    (("range-map", "paper", "--at", "tx_mm=inf"), "finite numbers"),
    (("range-map", "paper", "--axes", "tx,tx"), "allowed: two of"),
    (("range-map", "paper", "--axes", "tx,ty", "--axes", "tx,ty"), "tx,ty is given twice"),
    (("jacobian", "paper", "--box", "tx_mm=1,tx_mm=2"), "--box has tx_mm twice"),
    (("jacobian", "paper", "--states", "1_000"), "'1_000' is not a plain finite number"),
    (("simulate", "paper", "-o", ""), "it is empty"),
    (("simulate", "paper", "--motion", "yaw-sweep", "--motion", "yaw-sweep"), "given twice"),
    (("emulate", "bench", "--motion", "circle", "--faults", "flip=1,flip=2"), "flip twice"),
    (("acquire", "bench", "--seconds", "inf"), "'inf' is not a plain finite number"),
    (("calibrate", "rig", "d.csv", "--effect", "strips=on", "--effect", "strips=off"), "twice"),
]


@pytest.mark.parametrize(("words", "says"), BAD, ids=lambda value: " ".join(value))
def test_what_can_not_be_meant_is_refused(words, says, tmp_path):
    result = command(*words, cwd=tmp_path)
    assert result.returncode == 2
    assert says in result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("texts", "is_number"),
    [(["5"], True), (["-1e-3"], True), (["a_b"], False), (["tx,ty", "ty,tz"], False), ([], False)],
)
def test_what_can_be_meant_is_not(texts, is_number):
    assert why_meaningless(texts, is_number) == ""
