"""The checker accepts what was proved and refuses, with a reason, whatever was made of it."""

from __future__ import annotations

import ast
import hashlib
import json
import math
import subprocess
import sys
from fractions import Fraction
from functools import partial
from pathlib import Path

import pytest
from facets.experiments import (
    certificate_schema,
    check_certificate,
)
from sensors import SENSORS

import facets
from facets.characterization import parse_box
from facets.files import provenance
from facets.model import parameters
from facets.proof import certify, write_certificate

#: Small, so that a test is quick: one place and one angle.
BOX = parse_box("tx_mm=1,yaw_mrad=3")
SHARE = 0.29


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    path = tmp_path_factory.mktemp("proof") / "certificate.json"
    config = facets.load("paper")
    proof = certify(config.sensor, BOX, SHARE)
    about = provenance.provenance_header(config)
    write_certificate(path, config.sensor, proof, about, config.resolved)
    return path


@pytest.fixture
def content(certificate):
    return json.loads(certificate.read_text())


def put(content, pointer, value):
    """Put a value at a JSON Pointer, and seal a configuration that this changes."""
    *keys, last = pointer.split("/")[1:]
    place = content
    for key in keys:
        place = place[int(key) if isinstance(place, list) else key]
    place[int(last) if isinstance(place, list) else last] = value
    if keys[:1] == ["resolved"]:
        text = json.dumps(content["resolved"], separators=(",", ":"))
        content["config_sha256"] = hashlib.sha256(text.encode()).hexdigest()


#: A place in the file, what is put there, and why the file is refused.
CHANGES = [
    # types, sizes and limits by the schema
    ("/format", "facets uniqueness certificate 1", "needed"),
    ("/regular", "true", "needed: True"),
    ("/unique", 1, "needed: True"),
    ("/reason", " ", "needed: ''"),
    ("/margin", "0.5", "needed: number"),
    ("/weights/1", True, "needed: number"),
    ("/work", 0.5, "needed: integer"),
    ("/light", [], "needed: object"),
    ("/middles", "none", "needed: object or null"),
    ("/light", {}, "lacks"),
    ("/pieces/0/light", {}, "nothing is known"),
    ("/pieces", [], "0 entries"),
    ("/inverse", [[]] * 6, "0 entries"),
    ("/parameters", [0.0] * 29, "29 entries"),
    ("/doubtful", [None], "1 entries"),
    ("/inverse/0/0", math.nan, "NaN is no number"),
    ("/margin", 1.5, "margin"),
    ("/margin", 0.0, "margin"),
    ("/weights/0", -0.0, "weights"),
    ("/weights/2", 1e308, "too large"),
    ("/weights/2", 10**400, "too large"),
    ("/tolerances/0", -0.1, "tolerances"),
    ("/least_share", 0.0, "least_share"),
    ("/least_share", 0.5, "least_share"),
    # the configuration and its checksum
    ("/config_sha256", "0" * 64, "checksum"),
    ("/resolved", None, "without its configuration"),
    ("/parameters/12", 600.0, "not those"),
    ("/resolved/sensor", None, "no sensor"),
    ("/resolved/sensor/beam/diameter_mm", [1, 1, 1], "no sensor"),
    ("/resolved/sensor/psd/a/radius_mm", "250.0", "no sensor"),
    ("/resolved/sensor/lens", {"focal_mm": 50}, "lens"),
    ("/resolved/sensor/light", "ideal", "cannot be checked"),
    ("/resolved/sensor/light/curvature_per_m", [1e-300, 0, 0], "sensor.light"),
    ("/resolved/sensor/light/wavelength_nm", 0, "sensor.light"),
    ("/resolved/sensor/light/index", [0, 0], "sensor.light"),
    ("/resolved/sensor/apertures/beam_ratio", 0, "sensor.apertures"),
    ("/resolved/sensor/apertures/rim_mm", 0.0, "sensor.apertures"),
    # the box and its pieces
    ("/high/0", -3.0, "below its lower"),
    ("/pieces/0/high/0", 9.0, "not in the box"),
    ("/pieces/0/low/0", 0.5, "not in the box"),
    ("/high/1", 5e-324, "hole"),
    # the light
    ("/light/from_point/0/0", [1.0, -1.0], "crossed"),
    ("/light/from_point/0/0", [0.0, 0.0], "bounds of the light"),
    ("/light/turns/1/0/2", [-0.01, 0.01], "bounds of the light"),
    ("/light/slope", [1.0, 2.0], "bounds of the light"),
    ("/light/slope", [-1.0, 2.0], "slope"),
    ("/least_share", 0.02, "bounds of the light"),
    ("/least_share", 5e-324, "least share|apex far"),
    ("/tolerances/6", 0.5, "light|hull|face|half a turn|singular"),
    # what is claimed of the pieces
    ("/pieces/3/at_least", 1e12, "larger"),
    ("/least_determinant", 1e12, "least piece"),
    ("/inverse", [[0.0] * 6] * 6, "singular"),
    ("/inverse/2", [1.0] * 6, "singular"),
    ("/weights", [5e-324] * 6, "singular|checked"),
]  # fmt: skip


def leave_out_checksum(content):
    del content["config_sha256"]


def leave_out_piece(content):
    content["pieces"].pop()


def repeat_piece(content):
    """As many pieces, and as large."""
    content["pieces"] = [content["pieces"][0]] * len(content["pieces"])


def move_by_one_float(content):
    put(content, "/pieces/0/low/5", math.nextafter(content["pieces"][0]["low"][5], 1))


def flatten_pieces(content):
    """All pieces together have no volume."""
    for piece in content["pieces"]:
        piece["high"] = list(piece["low"])


def keep_corners(content):
    """Every corner of the box lies in a piece, and little else."""
    for piece in content["pieces"]:
        for axis in (0, 5):
            low, high = piece["low"][axis], piece["high"][axis]
            third = (high - low) / 3
            if low == content["low"][axis]:
                piece["high"][axis] = low + third
            else:
                piece["low"][axis] = high - third


def take_power(content):
    content["parameters"][0] = 0.0
    put(content, "/resolved/sensor/beam/power_mw", 0.0)


def turn_detector_away(content):
    content["parameters"][12] = -250.0
    put(content, "/resolved/sensor/psd/a/radius_mm", -250.0)


def take_another_sensor(content):
    """Hash, configuration and parameters of a singular sensor, the proof of another."""
    other = facets.load("singular")
    content |= {"resolved": other.resolved, "config_sha256": other.sha256}
    content["parameters"] = list(parameters(other.sensor))


FORGERIES = [
    *(
        pytest.param(partial(put, pointer=pointer, value=value), reason, id=f"{pointer} {reason}")
        for pointer, value, reason in CHANGES
    ),
    (leave_out_checksum, "checksum"),
    (leave_out_piece, "hole"),
    (repeat_piece, "hole"),
    (move_by_one_float, "hole"),
    (flatten_pieces, "hole"),
    (keep_corners, "hole"),
    (take_power, "no power"),
    (turn_detector_away, "behind|face"),
    (take_another_sensor, "bounds of the light|hull|claims"),
]


@pytest.mark.parametrize(("forge", "reason"), FORGERIES)
def test_what_is_forged_is_refused_with_a_reason(content, tmp_path, forge, reason):
    forge(content)
    path = tmp_path / "forged.json"
    path.write_text(json.dumps(content))
    with pytest.raises(certificate_schema.Refused, match=reason):
        check_certificate.check(path)


@pytest.mark.parametrize(
    ("margin", "before", "after"),
    [
        ("0.9, \"margin\": 0.9", "", ""),
        ("1e999", "", ""),
        ("9" * 5000, "", ""),
        ("0.9", "", "{}"),
        ("0.9", "", "\x80"),
        ("0.9", "[", "]"),
        ("0.9", "[" * 100_000, ""),
    ],
)  # fmt: skip
def test_what_is_no_certificate_is_refused(content, tmp_path, margin, before, after):
    content["margin"] = "MARGIN"
    text = before + json.dumps(content).replace('"MARGIN"', margin) + after
    path = tmp_path / "file.json"
    path.write_bytes(text.encode("latin-1"))
    for file in (path, tmp_path / "none.json"):
        with pytest.raises(certificate_schema.Refused):
            check_certificate.check(file)


def test_no_refusal_hangs_on_what_python_can_leave_out(certificate, tmp_path):
    """`python -O` leaves out `assert` and what asks for `__debug__`, and nothing else; beside its
    own files the checker imports nothing of the project."""
    files = sorted(Path(check_certificate.__file__).parent.glob("*certificate*.py"))
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            assert not isinstance(node, ast.Assert)
            assert not (isinstance(node, ast.Name) and node.id == "__debug__")
    forged = tmp_path / "forged.json"
    forged.write_text(certificate.read_text().replace('"unique": true', '"unique": false'))
    code = (
        "import sys; from facets.experiments.check_certificate import main\n"
        "main(sys.argv[1:])\n"
        "print(*(name for name in sys.modules if name.startswith('facets.')))"
    )
    run = subprocess.run(
        [sys.executable, "-O", "-c", code, forged], capture_output=True, text=True, check=True
    )
    answer, modules = run.stdout.splitlines()
    assert ": refused: " in answer
    core = {"facets.core", "facets.core.faces", "facets.core.version", "facets.experiments"}
    assert set(modules.split()) - core == {f"facets.experiments.{file.stem}" for file in files}


def test_the_checker_agrees_and_says_what_it_did_not_find_again(certificate, content, capsys):
    checked = check_certificate.check(certificate)
    assert 0.6 < (1 - content["margin"]) / (1 - checked.margin) <= 1
    assert 0.95 < checked.determinant / content["least_determinant"] <= 1.02
    assert "not verified: the bound" in check_certificate.describe(checked)
    assert "(facets, seconds, work)" not in check_certificate.describe(checked)
    assert check_certificate.main([str(certificate)]) == 0
    assert "holds" in capsys.readouterr().out
    assert check_certificate.main([]) == 2
    checked.margin, checked.determinant = Fraction(9999, 10000), Fraction(45759999, 10)
    assert "0.999;" in check_certificate.describe(checked)
    assert "4.57e6" in check_certificate.describe(checked)
    checked.determinant = Fraction(0)
    assert "at least 0" in check_certificate.describe(checked)


def test_the_schema_is_one_and_the_certificate_fits_it(content):
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(certificate_schema.SCHEMA)
    jsonschema.validate(content, certificate_schema.SCHEMA)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content | {"margin": -1}, certificate_schema.SCHEMA)


#: Tolerances of the 30 parameters, mm and rad.
OFF = [0.003, 0.0085, 0.0085, 0.0, 1e-3, 1e-3, *[5e-4] * 6, *[0.1, 4e-4, 0.1, 2e-3, 2e-3, 2e-3] * 3]


@pytest.mark.parametrize(
    ("name", "box", "share", "tolerances"),
    [("paper", BOX, 0.2, OFF), ("skewed1", parse_box("tx_mm=0.01"), 0.25, None)],
)
def test_the_checker_agrees_about_other_sensors(tmp_path, name, box, share, tolerances):
    """All those within tolerances; and one without symmetry, where facets have little more light
    than their share, so that bounds of the light are narrow."""
    sensor = SENSORS[name]
    proof = certify(sensor, box, share, tolerances=tolerances)
    write_certificate(tmp_path / "a.json", sensor, proof, {"config": "none"})
    checked = check_certificate.check(tmp_path / "a.json")
    assert 0.55 < (1 - proof.margin) / (1 - checked.margin) <= 1
    assert 0.95 < checked.determinant / proof.at_least <= 1.02
    assert any("configuration" in line for line in checked.not_verified)
    if tolerances:
        assert proof.margin < certify(sensor, box, share).margin


def test_an_older_claim_that_the_box_holds_the_range_is_not_checked(certificate, tmp_path):
    content = json.loads(certificate.read_text())
    assert "range" not in content
    (tmp_path / "older.json").write_text(json.dumps(content | {"range": {"boxes": 1}}))
    checked = check_certificate.check(tmp_path / "older.json")
    assert "that the box holds every pose of the range" in checked.not_verified
