"""What no maker of certificates writes: other types, other texts, pieces that only look whole."""

from __future__ import annotations

import copy
import hashlib
import json

import numpy as np
import pytest
from facets.experiments import certificate_schema, check_certificate

import facets
from facets.characterization import parse_box
from facets.files import provenance
from facets.proof import certify, write_certificate


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    path = tmp_path_factory.mktemp("attacks") / "certificate.json"
    config = facets.load("paper")
    found = certify(config.sensor, parse_box("tx_mm=1,yaw_mrad=3"), 0.29)
    write_certificate(
        path, config.sensor, found, provenance.provenance_header(config), config.resolved
    )
    return json.loads(path.read_text())


def sealed(content):
    """With the checksum of what the configuration has become."""
    text = json.dumps(content["resolved"], separators=(",", ":"))
    content["config_sha256"] = hashlib.sha256(text.encode()).hexdigest()


def put(value, *where, seal=False):
    *keys, last = where

    def spoil(content):
        place = content
        for key in keys:
            place = place[key]
        place[last] = value
        if seal:
            sealed(content)

    return spoil


def number(value, *where):
    """A parameter, both in the file and in its configuration."""
    index, *keys = where

    def spoil(content):
        content["parameters"][index] = value
        put(value, "resolved", "sensor", *keys, seal=True)(content)

    return spoil


def cross_ends(content):
    first = content["pieces"][0]
    first["low"], first["high"] = first["high"], first["low"]


def thin_pieces(content):
    """Pieces without width: all of them together have no volume."""
    for piece in content["pieces"]:
        piece["high"] = list(piece["low"])


def only_corners(content):
    """Every corner of the box lies in a piece, and little else."""
    for piece in content["pieces"]:
        for axis in (0, 5):
            low, high = piece["low"][axis], piece["high"][axis]
            third = (high - low) / 3
            if low == content["low"][axis]:
                piece["high"][axis] = low + third
            else:
                piece["low"][axis] = high - third


def same_piece_many_times(content):
    content["pieces"] = [content["pieces"][0]] * len(content["pieces"])


def mirror_box(content):
    content["low"], content["high"] = content["high"], content["low"]


def hidden_in_subnormal(content):
    """A box wider by the least float there is."""
    content["high"][1] = 5e-324


def swap_axes(content):
    for piece in [*content["pieces"], content]:
        for end in ("low", "high"):
            piece[end] = piece[end][::-1]


def still_light(content):
    """Light that does not move when the mirror turns."""
    content["light"]["turns"] = [[[[0.0, 0.0]] * 3] * 2] * 3


def prefix_of_another(content):
    other = facets.load("skewed")
    content["resolved"] = other.resolved
    content["config_sha256"] = other.sha256[:32] + content["config_sha256"][32:]


def other_sensor_whole(content):
    """Hash, configuration and parameters of another sensor, the proof of this."""
    from facets.model import parameters

    other = facets.load("singular")
    content |= {"resolved": other.resolved, "config_sha256": other.sha256}
    content["parameters"] = list(parameters(other.sensor))


def deep(content):
    nest = []
    for _ in range(900):
        nest = [nest]
    content["resolved"]["nest"] = nest


SPOILS = {
    "numbers as text": (put("0.5", "margin"), "needed: number"),
    "a number in a list": (put([0.5], "margin"), "needed: number"),
    "no margin": (put(None, "margin"), "needed: number"),
    "a margin of no digit": (put(5e-324, "least_share"), "least share|apex far"),
    "NaN as text": (put("NaN", "inverse", 0, 0), "needed: number"),
    "NaN deep in a text of the light": (put(["nan", "nan"], "light", "slope"), "needed: number"),
    "truth as a bound": (put([True, True], "light", "slope"), "needed: number"),
    "a record as a list": (put({}, "pieces"), "needed: array"),
    "a list as a record": (put([], "light"), "needed: object"),
    "a text as pieces": (put("pieces", "pieces"), "needed: array"),
    "no light": (put({}, "light"), "lacks"),
    "empty rows": (put([[]] * 6, "inverse"), "0 entries"),
    "no rows": (put([], "inverse"), "0 entries"),
    "no weights": (put([], "weights"), "0 entries"),
    "weights of the least float": (put([5e-324] * 6, "weights"), "singular|checked"),
    "a weight of minus zero": (put(-0.0, "weights", 0), "weights"),
    "an integer of 300 digits": (put(10**300, "parameters", 12), "too large|not those"),
    "an integer of 400 digits as work": (put(10**400, "work"), "too large"),
    "half a piece of work": (put(0.5, "work"), "needed: integer"),
    "a negative time": (put(-1.0, "seconds"), "seconds"),
    "pieces without width": (thin_pieces, "hole"),
    "pieces with crossed ends": (cross_ends, "not in the box"),
    "pieces at the corners only": (only_corners, "hole"),
    "one piece many times": (same_piece_many_times, "hole"),
    "a piece of no piece": (put(None, "pieces", 0), "needed: object"),
    "a piece in a piece": (lambda c: put([c["pieces"][0]], "pieces", 0)(c), "needed: object"),
    "a piece of seven axes": (lambda c: c["pieces"][0]["low"].append(0.0), "7 entries"),
    "a piece with its own light": (put({}, "pieces", 0, "light"), "nothing is known"),
    "a box with its ends swapped": (mirror_box, "below its lower"),
    "a box wider by the least float": (hidden_in_subnormal, "hole"),
    "axes in another order": (swap_axes, "light|half a turn|singular|larger"),
    "light that stays where it is": (still_light, "light"),
    "regular as text": (put("true", "regular"), "needed: True"),
    "unique as nothing": (put(None, "unique"), "needed: True"),
    "reason of a blank": (put(" ", "reason"), "needed: ''"),
    "format with a blank": (put("facets uniqueness certificate 2 ", "format"), "needed"),
    "checksum in capitals": (lambda c: put(c["config_sha256"].upper(), "config_sha256")(c),
                             "checksum"),
    "checksum with another's head": (prefix_of_another, "checksum"),
    "another sensor, whole in itself": (other_sensor_whole, "light|hull|singular|claims"),
    "configuration as text": (put("paper", "resolved"), "needed: object or null"),
    "configuration forgotten": (put(None, "resolved"), "without its configuration"),
    "sensor of nothing": (put(None, "resolved", "sensor", seal=True), "no sensor"),
    "three diameters": (put([1, 1, 1], "resolved", "sensor", "beam", "diameter_mm", seal=True),
                        "no sensor"),
    "a radius as text": (put("250.0", "resolved", "sensor", "psd", "a", "radius_mm", seal=True),
                         "no sensor"),
    "a lens": (put({"focal_mm": 50}, "resolved", "sensor", "lens", seal=True), "lens"),
    "light as text": (put("ideal", "resolved", "sensor", "light", seal=True), "checked|sensor"),
    "a curved wavefront": (put([1e-300, 0, 0], "resolved", "sensor", "light", "curvature_per_m",
                               seal=True), "sensor.light"),
    "an aperture of no size": (put(0, "resolved", "sensor", "apertures", "beam_ratio", seal=True),
                               "sensor.apertures"),
    "a rim of no size": (put(0.0, "resolved", "sensor", "apertures", "rim_mm", seal=True),
                         "sensor.apertures"),
    "a wavelength of zero": (put(0, "resolved", "sensor", "light", "wavelength_nm", seal=True),
                             "sensor.light"),
    "a coating of index zero": (put([0, 0], "resolved", "sensor", "light", "index", seal=True),
                                "sensor.light"),
    "a configuration nested deep": (deep, "checksum|checked"),
    "a power of zero": (number(0.0, 0, "beam", "power_mw"), "no power"),
    "a negative power": (number(-0.3, 0, "beam", "power_mw"), "no power"),
    "a radius the wrong way": (number(-250.0, 12, "psd", "a", "radius_mm"), "behind|face"),
    "a tolerance of everything": (put(1e299, "tolerances", 12), "behind|face|singular|light"),
    "a range of nothing": (put({}, "range"), "lacks"),
    "a range within no distance": (
        put({"farthest": [0.0] * 6, "halves_mm": [[6.5] * 2] * 3, "whole_spot": True, "boxes": 1},
            "range"), "farthest"),
    "a range of another rule": (
        put({"farthest": [1.0] * 6, "halves_mm": [[6.5] * 2] * 3, "whole_spot": False, "boxes": 1},
            "range"), "whole_spot"),
    "a range of small detectors": (
        put({"farthest": [1.0] * 6, "halves_mm": [[1.0] * 2] * 3, "whole_spot": True, "boxes": 1},
            "range"), "half the detectors"),
    "an affine part of text": (put("none", "middles"), "needed: object or null"),
}  # fmt: skip


@pytest.mark.parametrize("name", SPOILS)
def test_it_is_refused_with_a_reason(content, tmp_path, name):
    spoil, reason = SPOILS[name]
    spoilt = copy.deepcopy(content)
    spoil(spoilt)
    path = tmp_path / "spoilt.json"
    path.write_text(json.dumps(spoilt))
    with pytest.raises(certificate_schema.Refused, match=reason):
        check_certificate.check(path)


def instead(old, new):
    return lambda text: text.replace(f'"{old}":', new, 1)


TEXTS = {
    "a key twice": instead("margin", '"margin": 0.9, "margin":'),
    "a key twice in a piece": instead("at_least", '"at_least": 0, "at_least":'),
    "a key twice, in code points": instead("margin", '"\\u006dargin": 0.9, "margin":'),
    "a number past all floats": instead("seconds", '"seconds": 1e999, "s":'),
    "minus infinity": instead("margin", '"margin": -Infinity, "m":'),
    "an integer of 5000 digits": instead("work", f'"work": {"9" * 5000}, "w":'),
    "something after the end": lambda text: text + "{}",
    "a comment": lambda text: "// trust me\n" + text,
    "the end left out": lambda text: text[:-2],
    "a certificate in a list": lambda text: f"[{text}]",
    "a mark of the byte order": lambda text: "\ufeff" + text,
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_text_that_is_none_is_refused(content, tmp_path, name):
    path = tmp_path / "spoilt.json"
    text = TEXTS[name](json.dumps(content))
    assert text != json.dumps(content)
    path.write_text(text)
    with pytest.raises(certificate_schema.Refused):
        check_certificate.check(path)
    assert check_certificate.main([str(path)]) == 1


@pytest.mark.parametrize("data", [b"\xff\xfe{\x00}\x00", b"\x00" * 100, b"\x80"])
def test_bytes_that_are_no_text_are_refused(tmp_path, data):
    path = tmp_path / "spoilt.json"
    path.write_bytes(data)
    with pytest.raises(certificate_schema.Refused, match="read"):
        check_certificate.check(path)


def test_nothing_of_the_above_is_what_it_begins_with(content, tmp_path):
    path = tmp_path / "sound.json"
    path.write_text(json.dumps(content))
    assert check_certificate.check(path).margin > 0


def test_numbers_changed_at_random_prove_nothing_that_is_not_so(content, tmp_path):
    """Where such a file is still taken, its box, its sensor and its share are as they were."""
    rng, path = np.random.default_rng(3), tmp_path / "spoilt.json"
    for _ in range(5):
        spoilt = copy.deepcopy(content)
        key = rng.choice(["inverse", "weights"])
        values = np.array(spoilt[key])
        values.flat[rng.integers(values.size)] *= rng.choice([-1.0, 0.0, 0.5, 1.01, 1e3])
        spoilt[key] = values.tolist()
        path.write_text(json.dumps(spoilt))
        try:
            found = check_certificate.check(path)
        except certificate_schema.Refused:
            continue
        assert 0 < found.margin < 1
