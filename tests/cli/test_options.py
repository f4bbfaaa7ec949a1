"""Options mean the same in every command, odd values are refused."""

from __future__ import annotations

import re
from collections import defaultdict

import pytest
from commands import all_commands, command
from facets.cli.command import OPTIONAL_VALUES, why_meaningless

BAD = [
    (("range-map", "paper", "--at", ""), "'--at': the value is empty"),
    (("range-map", "paper", "--at", "tx_mm=1,tx_mm=2"), "--at has tx_mm twice"),
    (("range-map", "paper", "--at", "tx_mm=1_0"), "--at has 'tx_mm=1_0'"),
    (("range-map", "paper", "--at", "tx_mm=inf"), "finite numbers"),
    (("range-map", "paper", "--axes", "tx,tx"), "allowed: two of"),
    (("range-map", "paper", "--axes", "tx,ty", "--axes", "tx,ty"), "tx,ty is given twice"),
    (("jacobian", "paper", "--box", "tx_mm=1,tx_mm=2"), "--box has tx_mm twice"),
    (("jacobian", "paper", "--states", "1_000"), "'1_000' is not a plain finite number"),
    (("simulate", "paper", "-d", ""), "the value is empty"),
    (("simulate", "paper", "--motion", "yaw-sweep", "--motion", "yaw-sweep"), "given twice"),
    (("emulate", "bench", "--motion", "circle", "--faults", "flip=1,flip=2"), "flip twice"),
    (("acquire", "bench", "--seconds", "inf"), "'inf' is not a plain finite number"),
    (("calibrate", "rig", "d.csv", "--effect", "strips=on", "--effect", "strips=off"), "twice"),
    (("calibrate", "rig", "d.csv", "--only", "gain"), "by commas; did you mean 'gains'?"),
    (("calibrate", "rig", "--propose", "9", "--only", "beam"), "takes no DATA, no --only"),
    (("solve", "paper", "d.csv", "--beam", "knwon"), "free, known, prior; did you mean 'known'?"),
    (("render", "paper", "--width", "100"), "100 is out of range; allowed: 200 to 8,000"),
    (("axis", "none", "--axis", "X"), "none: no such file"),
    (("explore", "layout", "-o", "out"), "the folder is --folder"),
    (("optimize", "layout", "--report", "--force"), "a value is missing before the option --force"),
    (("simulate", "paper", "--zero", "2 s"), "--zero is '2 s'; allowed: seconds such as 2s"),
    (("simulate", "paper", "--zero", "row:0"), "a row such as row:1"),
    (("simulate", "paper", "--zero", "none.csv"), "none.csv: no such file"),
    (("simulate", "paper", "--motion", "yaw-sweep", "--zero", "row:402"),
     "row 402, but motion yaw-sweep has only 401 rows"),
    (("simulate", "market"), "has no motions; describe one in the block motions"),
    (("simulate", "paper", "--point", "0,50"), "--point is '0,50'; allowed: three numbers in mm"),
    (("simulate", "paper", "--point", "0,0,1e5"), "up to 10,000"),
    (("range-map", "paper", "--axes", "tx,sideways"), "allowed: two of tx, ty"),
    (("range-map", "paper", "--at", "tz_mm=high"), "allowed: NAME=NUMBER"),
    (("range-map", "paper", "--at", "tz_mm=20"), "spot leaves the PSD"),
    (("range-map", "paper", "--at", "tx_mm=3"), "µW, and range.snr 810 requires 32.4 µW"),
    (("jacobian", "paper", "--states", "100000000000"),
     "allowed: 1 to 1,073,741,824"),
    (("jacobian", "paper", "--box", "x=1"), "error: --box has 'x=1'"),
    (("jacobian", "paper", "--box", "yaw_mrad=nan"), "allowed: up to"),
    (("jacobian", "paper", "--box", "tx_mm=8000:9000"), "gives every detector a reading"),
]  # fmt: skip


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
    assert why_meaningless(texts, is_number, {"--force"}) == ""


def meaning(param):
    """Type and meaning of a parameter; what one command adds follows a colon or in brackets."""
    common = re.split(r": |  \[", param.help)[0].rstrip(".")
    kind = param.type_descriptor.annotation
    element = getattr(kind, "__args__", (kind,))[0]
    return common, element, tuple(param.opts), tuple(param.secondary_opts), param.metavar


def test_an_option_has_one_type_and_one_meaning_in_all_commands():
    meanings = defaultdict(dict)
    for context, inner in all_commands():
        for param in inner.params:
            for name in (*param.opts, *param.secondary_opts):
                meanings[name].setdefault(meaning(param), []).append(context.command_path)
    shared = [name for name, found in meanings.items() if sum(map(len, found.values())) > 1]
    assert len(shared) > 20
    assert {name: found for name, found in meanings.items() if len(found) > 1} == {}


@pytest.mark.parametrize(
    ("typed", "value"),
    [(["--certify", "paper"], 20000), (["--certify", "30", "paper"], 30), (["paper"], 0),
     (["paper", "--certify=5"], 5)],
)  # fmt: skip
def test_a_value_may_be_left_out(typed, value):
    inner = next(inner for context, inner in all_commands() if context.info_name == "jacobian")
    assert inner.make_context("jacobian", typed).params["certify"] == value
    assert set(OPTIONAL_VALUES) == {"--certify", "--web"}
