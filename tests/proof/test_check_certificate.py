"""The checker accepts what was proved and refuses, with a reason, whatever was made of it."""

from __future__ import annotations

import ast
import copy
import json
import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest
from facets.experiments import (
    certificate_optics,
    certificate_range,
    certificate_schema,
    check_certificate,
)
from sensors import SENSORS

import facets
from facets.characterization import box_of_poses, least_share, parse_box, range_box
from facets.files import provenance
from facets.proof import certify, cover_range, write_certificate
from facets.proof.reach import find_reach

#: Small, so that a test is quick: two angles and one place, whose pieces are cut in three axes.
BOX = parse_box("tx_mm=2,roll_mrad=4,yaw_mrad=6")
#: One with another angle, whose pieces are cut in four axes.
LARGER = parse_box("tx_mm=2,roll_mrad=4,pitch_mrad=4,yaw_mrad=6")
SHARE = 0.27


def certificate_of(box, folder):
    path = folder / "certificate.json"
    config = facets.load("paper")
    found = certify(config.sensor, box, SHARE)
    assert found.unique
    write_certificate(
        path, config.sensor, found, provenance.provenance_header(config), config.resolved
    )
    return path


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    return certificate_of(BOX, tmp_path_factory.mktemp("proof"))


@pytest.fixture(scope="module")
def content(certificate):
    return json.loads(certificate.read_text())


@pytest.fixture(scope="module")
def larger(tmp_path_factory):
    """What is found again in the certificate of the larger box."""
    return check_certificate.check(certificate_of(LARGER, tmp_path_factory.mktemp("larger")))


def put(value, *keys):
    """What puts a value at a place of a certificate."""

    def spoil(content):
        for key in keys[:-1]:
            content = content[key]
        content[keys[-1]] = value

    return spoil


def change(function, *keys):
    def spoil(content):
        for key in keys[:-1]:
            content = content[key]
        content[keys[-1]] = function(content[keys[-1]])

    return spoil


def resize(content, name, by):
    content["parameters"][name] *= by


def shrink_all_pieces(content):
    """A hole of 3 % on every side of every axis, invisible to a volume in six dimensions."""
    for piece in content["pieces"]:
        for axis in range(6):
            width = content["high"][axis] - content["low"][axis]
            for end in ("low", "high"):
                if piece[end][axis] in (content["low"][axis], content["high"][axis]):
                    piece[end][axis] *= 0.97 if width else 1


def swap_pieces(content):
    """Two pieces for one: as many, as large, and a hole."""
    content["pieces"][0] = copy.deepcopy(content["pieces"][1])


def forget_hash(content):
    del content["config_sha256"]


def other_sensor(content):
    """Configuration and checksum of another sensor, whole in themselves."""
    other = facets.load("skewed")
    content |= {"resolved": other.resolved, "config_sha256": other.sha256}


def with_apertures(content):
    config = facets.load("paper")
    content["resolved"] = copy.deepcopy(config.resolved)
    content["resolved"]["sensor"]["apertures"]["rim_mm"] = 5.0
    text = json.dumps(content["resolved"], separators=(",", ":"))
    import hashlib

    content["config_sha256"] = hashlib.sha256(text.encode()).hexdigest()


def as_the_review_forged(content):
    """The certificate that the first checker took, with a margin of 1."""
    content["inverse"] = [[math.nan] * 6 for _ in range(6)]
    content["weights"] = [math.inf] * 6


def huge_weights(content):
    content["weights"] = [1e308] * 6


def singular_sensor(content):
    sensor = facets.load("singular")
    from facets.model import parameters

    content |= {"resolved": sensor.resolved, "config_sha256": sensor.sha256}
    content["parameters"] = list(parameters(sensor.sensor))


SPOILS = {
    "NaN and infinities as the review forged them": (as_the_review_forged, "no number"),
    "singular sensor with a proof of another": (singular_sensor, "bounds of the light|hull|claims"),
    "NaN in inverse": (put(math.nan, "inverse", 0, 0), "NaN is no number"),
    "infinite weight": (put(math.inf, "weights", 2), "Infinity is no number"),
    "number past floats": (put(10**400, "weights", 2), "too large|finite|range"),
    "weights near the largest float": (huge_weights, "too large"),
    "weight zero": (put(0.0, "weights", 1), "weights"),
    "weight below zero": (put(-1.0, "weights", 1), "weights"),
    "weight of text": (put("1.0", "weights", 1), "needed: number"),
    "weight of truth": (put(True, "weights", 1), "needed: number"),
    "inverse of five rows": (change(lambda rows: rows[:5], "inverse"), "5 entries"),
    "inverse of zeros": (put([[0.0] * 6] * 6, "inverse"), "singular|claims"),
    "inverse scaled": (change(lambda row: [2 * x for x in row], "inverse", 2), "singular"),
    "inverse transposed": (change(lambda m: [list(r) for r in zip(*m)], "inverse"), "singular"),  # noqa: B905
    "piece left out": (change(lambda pieces: pieces[:-1], "pieces"), "hole"),
    "no pieces": (put([], "pieces"), "0 entries"),
    "piece twice for two": (swap_pieces, "hole"),
    "hole on every side": (shrink_all_pieces, "hole"),
    "hole of one float": (
        lambda c: put(math.nextafter(c["pieces"][0]["low"][5], 1), "pieces", 0, "low", 5)(c),
        "hole",
    ),
    "piece beyond the box": (put(9.0, "pieces", 0, "high", 0), "not in the box"),
    "box larger than its pieces": (put(2.1, "high", 0), "hole"),
    "box upside down": (put(-3.0, "high", 0), "below its lower"),
    "bounds of turns too narrow": (put([-0.01, 0.01], "light", "turns", 1, 0, 2), "light"),
    "bounds of centroids too narrow": (put([0.0, 0.0], "light", "from_point", 0, 0), "light"),
    "bounds of the light crossed": (put([1.0, -1.0], "light", "from_point", 0, 0), "crossed"),
    "slope too large": (put([1.0, 2.0], "light", "slope"), "light"),
    "slope of no sign": (put([-1.0, 2.0], "light", "slope"), "slope"),
    "least share lower": (put(0.02, "least_share"), "light"),
    "least share zero": (put(0.0, "least_share"), "least_share"),
    "least share of half": (put(0.5, "least_share"), "least_share"),
    "determinant of a piece": (change(lambda x: 1e4 * x, "pieces", 3, "at_least"), "larger"),
    "least determinant": (change(lambda x: 1.5 * x, "least_determinant"), "least piece"),
    "margin above one": (put(1.5, "margin"), "margin"),
    "margin below zero": (put(-0.5, "margin"), "margin"),
    "not unique": (put(False, "unique"), "unique"),
    "unique as a number": (put(1, "unique"), "unique"),
    "doubtful pieces": (lambda c: put([c["pieces"][0]], "doubtful")(c), "doubtful"),
    "a reason against it": (put("out of time", "reason"), "reason"),
    "parameters of another sensor": (put(600.0, "parameters", 12), "not those"),
    "parameters left out": (change(lambda p: p[:29], "parameters"), "29 entries"),
    "tolerances beyond the proof": (
        put(0.5, "tolerances", 6),
        "light|hull|face|half a turn|singular",
    ),
    "tolerance below zero": (put(-0.1, "tolerances", 0), "tolerances"),
    "checksum": (put("0" * 64, "config_sha256"), "checksum"),
    "checksum left out": (forget_hash, "checksum"),
    "configuration changed": (put("laser", "resolved", "sensor", "noise", "model"), "checksum"),
    "configuration of another sensor": (other_sensor, "not those"),
    "configuration without a sensor": (put({}, "resolved"), "checksum"),
    "apertures": (with_apertures, "apertures"),
    "another format": (put("facets uniqueness certificate 1", "format"), "needed"),
    "a key too many": (put(1, "trust_me"), "nothing is known"),
    "a key too few": (lambda c: c.pop("light"), "lacks light"),
}


@pytest.mark.parametrize("name", SPOILS)
@pytest.mark.slow
def test_what_is_spoilt_is_refused_with_a_reason(content, tmp_path, name):
    spoil, reason = SPOILS[name]
    spoilt = copy.deepcopy(content)
    spoil(spoilt)
    path = tmp_path / "spoilt.json"
    path.write_text(json.dumps(spoilt))
    with pytest.raises(certificate_schema.Refused, match=reason):
        check_certificate.check(path)


#: Where the checker's parts are.
CHECKER = Path(check_certificate.__file__).parent


@pytest.mark.parametrize("file", sorted(CHECKER.glob("*certificate*.py")), ids=lambda f: f.name)
def test_no_refusal_hangs_on_what_python_can_leave_out(file):
    """`python -O` leaves out `assert` and what asks for `__debug__`, and nothing else."""
    nodes = list(ast.walk(ast.parse(file.read_text())))
    assert not any(isinstance(node, ast.Assert) for node in nodes)
    assert not any(isinstance(node, ast.Name) and node.id == "__debug__" for node in nodes)


def test_the_checker_is_made_of_these_files():
    """Beside them it imports nothing of the project, whose assertions would count, too."""
    code = (
        "import sys, facets.experiments.check_certificate\n"
        "print(*(name for name in sys.modules if name.startswith('facets.')))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    known = {f"facets.experiments.{file.stem}" for file in CHECKER.glob("*certificate*.py")}
    core = {"facets.core", "facets.core.faces", "facets.core.version", "facets.experiments"}
    assert set(run.stdout.split()) - core == known


def test_without_asserts_the_same_is_refused(content, tmp_path):
    """A few of them, those that the least of the checker has seen through."""
    files = []
    few = [name for name in SPOILS if "reason" in name or "checksum" in name or "weight" in name]
    for number, name in enumerate(few):
        spoilt = copy.deepcopy(content)
        SPOILS[name][0](spoilt)
        files.append(tmp_path / f"{number}.json")
        files[-1].write_text(json.dumps(spoilt))
    command = [sys.executable, "-O", "-m", "facets.experiments.check_certificate", *map(str, files)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 1, run.stderr
    assert run.stdout.count(": refused: ") == len(few) > 5
    assert "holds" not in run.stdout


@pytest.mark.parametrize("text", ["", "{", "[]", "7", '{"a": 1, "a": 2}', "[" * 100_000])
def test_what_is_no_certificate_is_refused(tmp_path, text):
    path = tmp_path / "file.json"
    path.write_text(text)
    with pytest.raises(certificate_schema.Refused):
        check_certificate.check(path)
    with pytest.raises(certificate_schema.Refused, match="read"):
        check_certificate.check(tmp_path / "none.json")


@pytest.mark.slow
def test_the_checker_agrees_and_says_what_it_did_not_find_again(larger, certificate, capsys):
    assert larger.margin > Fraction(1, 2)
    assert larger.determinant > 0
    assert "seconds" in check_certificate.describe(larger)
    assert check_certificate.main([str(certificate)]) == 0
    assert "holds" in capsys.readouterr().out
    assert check_certificate.main([]) == 2


def test_bounds_are_told_rounded_down(larger):
    found = copy.copy(larger)
    found.margin, found.determinant = Fraction(9999, 10000), Fraction(45759999, 10)
    assert "0.999;" in check_certificate.describe(found)
    assert "4.57e6" in check_certificate.describe(found)
    found.determinant = Fraction(0)
    assert "at least 0" in check_certificate.describe(found)


def test_the_schema_is_one_and_the_certificate_fits_it(content):
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(certificate_schema.SCHEMA)
    jsonschema.validate(content, certificate_schema.SCHEMA)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content | {"margin": -1}, certificate_schema.SCHEMA)
    certificate_schema.conform(content, certificate_schema.SCHEMA)


def test_a_proof_for_all_sensors_within_tolerances_is_checked(tmp_path):
    sensor = SENSORS["paper"]
    off = [
        0.003,
        0.0085,
        0.0085,
        0.0,
        1e-3,
        1e-3,
        *[5e-4] * 6,
        *[0.1, 4e-4, 0.1, 2e-3, 2e-3, 2e-3] * 3,
    ]
    found = certify(sensor, BOX, SHARE, tolerances=off)
    assert found.unique
    assert 0 < found.margin < certify(sensor, BOX, SHARE).margin
    write_certificate(tmp_path / "a.json", sensor, found, {"config": "paper"})
    again = check_certificate.check(tmp_path / "a.json")
    assert again.margin > 0
    assert any("configuration" in line for line in again.not_verified)


def test_the_reach_has_a_certificate_that_is_checked(tmp_path):
    sensor = SENSORS["paper"]
    factor, found = find_reach(sensor, BOX, SHARE, farthest=2.0)
    assert factor == 2.0
    write_certificate(tmp_path / "a.json", sensor, found, {"config": "paper"})
    assert check_certificate.check(tmp_path / "a.json").margin > 0


#: Poses among which a test looks for the range: some per cent more than the box, and quicker than
#: all that a certificate looks among.
NEAR = [16.5, 16.5, 8.9, 0.0211, 0.02251, 0.0361]


@pytest.fixture(scope="module")
def whole_range(tmp_path_factory):
    """A certificate of the whole range of the paper's sensor."""
    path = tmp_path_factory.mktemp("range") / "certificate.json"
    config = facets.load("paper")
    share = least_share(config.sensor, config.range)
    cover = cover_range(config.sensor, config.range, share)
    found = certify(config.sensor, box_of_poses(cover.low, cover.high), share)
    assert found.unique
    assert found.margin > 0.3
    axes = range_box(config.sensor, config.range)
    assert (cover.low <= axes.low[:6]).all()
    assert (cover.high >= axes.high[:6]).all()
    about = provenance.provenance_header(config)
    write_certificate(path, config.sensor, found, about, config.resolved, cover)
    content = json.loads(path.read_text())
    content["range"]["farthest"] = NEAR
    return content


def check_only_range(content):
    return certificate_range.check_range(
        certificate_optics.IntervalSensor(content["parameters"], content["tolerances"]), content
    )


@pytest.mark.slow
def test_that_the_box_holds_the_range_is_found_again(whole_range, tmp_path):
    path = tmp_path / "certificate.json"
    path.write_text(json.dumps(whole_range))
    found = check_certificate.check(path)
    near = "16.5, 16.5, 8.9 mm and 21.1, 22.5, 36.1 mrad"
    assert f"every pose of the range, of those within {near}" in check_certificate.describe(found)
    assert not any("range" in line for line in found.not_verified)


def half_the_box(content):
    content |= {"low": [x / 2 for x in content["low"]], "high": [x / 2 for x in content["high"]]}


def one_face_moved_in(content):
    content["high"][5] /= 3


SPOILT_RANGES = {
    "half the box": (half_the_box, "may keep the rules"),
    "one face of the box moved in": (one_face_moved_in, "may keep the rules"),
    "poses within a nanometre": (put([1e-9] * 6, "range", "farthest"), "beyond the box"),
    "poses as far as the box in one axis": (
        lambda c: put(max(-c["low"][4], c["high"][4]), "range", "farthest", 4)(c),
        "beyond the box.*axis 5",
    ),
    "smaller detectors": (put(6.0, "range", "halves_mm", 1, 0), "half the detectors"),
    "centroids for whole spots": (put("centroid", "resolved", "range", "spot"), "whole_spot"),
    "a share that is too large": (put(0.2, "least_share"), "least_share is more"),
    "a lower ratio in the rules": (put(100, "resolved", "range", "snr"), "least_share is more"),
    "no rules": (lambda c: c["resolved"].pop("range"), "no rules"),
    "a ratio of text": (put("much", "resolved", "range", "snr"), "no rules"),
    "two sizes for three": (change(lambda sizes: sizes[:1], *("resolved", "sensor", "psd", "a",
                                                              "size_mm")), "no rules"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILT_RANGES)
@pytest.mark.slow
def test_a_range_that_the_box_does_not_hold_is_refused(whole_range, name):
    spoil, reason = SPOILT_RANGES[name]
    spoilt = copy.deepcopy(whole_range)
    spoil(spoilt)
    with pytest.raises(certificate_schema.Refused, match=reason):
        check_only_range(spoilt)


@pytest.mark.slow
@pytest.mark.parametrize("part", [1e-6, 0.1, 0.6])
def test_a_false_claim_of_a_range_shows_before_anything_is_cut(whole_range, monkeypatch, part):
    """A tenth of the box took 200 s of cutting to refuse."""
    monkeypatch.setattr(certificate_range, "MOST", 0)
    content = copy.deepcopy(whole_range)
    content |= {end: [part * x for x in content[end]] for end in ("low", "high")}
    with pytest.raises(
        certificate_schema.Refused, match="may keep the rules of the range, outside of the box"
    ):
        check_only_range(content)


@pytest.mark.slow
def test_what_the_electronics_make_of_the_least_share_is_not_found_again(whole_range):
    content = copy.deepcopy(whole_range)
    content["resolved"]["sensor"]["noise"]["model"] = "electronics"
    assert "electronics" in certificate_range.check_rules(content)[0]
    content["resolved"] = None
    assert "any configuration" in certificate_range.check_rules(content)[0]
