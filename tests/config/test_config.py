"""Configurations: defaults, inheritance, units, and errors that name file, line and key."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from facets import ConfigError, Correction, Sensor
from facets.config import (
    Random,
    Sine,
    Steps,
    Sweep,
    Table,
    fingerprint,
    key_names,
    load,
    schema,
    shipped,
    to_yaml,
    write_sensor,
)
from facets.core import unit_in

pytestmark = pytest.mark.installed


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes a file into an empty current folder and gives its path."""
    monkeypatch.chdir(tmp_path)

    def write_file(text: str, name: str = "my.yaml") -> Path:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write_file


def problems(path: Path) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(path)
    return str(caught.value).splitlines()


# ---- what a configuration gives


def test_the_shipped_paper_is_the_default_sensor():
    config = load("paper")
    assert config.sensor == Sensor()
    assert (config.name, config.noise, config.seed) == ("paper", True, 1)
    assert list(config.motions) == ["x-steps", "yaw-sweep", "multi-axis"]


def test_blocks_whose_keys_are_all_commented_out_take_the_defaults(write):
    assert load(write("sensor:\n  beam:\n    # power_mw: 1\nmotions:\n")).sensor == Sensor()


@pytest.mark.parametrize("name", sorted(shipped()))
def test_shown_and_loaded_again_it_is_the_same(name, write):
    config = load(name)
    again = load(write(to_yaml(config)))
    assert again.sha256 == fingerprint(again.resolved) == config.sha256
    assert (again.sensor, again.motions) == (config.sensor, config.motions)


def test_a_block_emptied_in_a_file_that_extends_keeps_what_it_inherits(write):
    config = load(write("extends: skewed\nsensor:\nmotions:\n"))
    assert config.sha256 == load("skewed").sha256


def test_tiny_and_huge_numbers_and_odd_names_survive_showing(write):
    text = "sensor: {beam: {power_mw: 1e-5}}\nmotions: {'on': {kind: sweep, rate_hz: 1.0e+8}}\n"
    config = load(write(text))
    again = load(write(to_yaml(config), "again.yaml"))
    assert again.sensor.beam.power == 1e-5
    assert '"on":' in to_yaml(config)  # a YAML 1.1 reader takes a bare on for true
    assert again.resolved == config.resolved


def test_every_unit_is_converted(write):
    config = load(
        write(
            """
sensor:
  beam: {power_mw: 1, diameter_mm: [0.8, 0.9], rotation_deg: 90, tilt_mrad: [3, -2]}
  mirror: {a: {inclination_deg: 45.5}}
  psd: {b: {radius_mm: 200, height_mm: 1, roll_mrad: 4, pitch_mrad: 5, yaw_mrad: 6}}
  noise: {position_um: 3, at_power_mw: 0.2, power_uw: 5}
  light: {profile: [0.01, 0, 0.02, 0, 0.01]}
solve: {beam_sigma_um: 7}
range: {spot: centroid}
"""
        )
    )
    beam, psd, noise = config.sensor.beam, config.sensor.psds[1], config.sensor.noise
    assert (beam.power, beam.diameter_x, beam.diameter_y) == (1.0, 0.8, 0.9)
    assert (beam.rotation, beam.tilt_x, beam.tilt_y) == (math.pi / 2, 0.003, -0.002)
    assert config.sensor.facets[0].inclination == math.radians(45.5)
    assert (psd.radius, psd.height, psd.roll, psd.pitch, psd.yaw) == (200, 1, 0.004, 0.005, 0.006)
    assert (noise.position, noise.at_power, noise.power) == (0.003, 0.2, 0.005)
    assert config.sensor.light.profile == (0.01, 0.0, 0.02, 0.0, 0.01)
    assert config.solve.beam_sigma == 0.007
    assert not config.range.whole_spot


def test_common_keys_apply_to_all_and_single_ones_override(write):
    sensor = load(
        write("sensor: {psd: {yaw_mrad: 2, size_mm: [12, 14], b: {yaw_mrad: 3, size_mm: 15}}}")
    ).sensor
    assert [psd.yaw for psd in sensor.psds] == [0.002, 0.003, 0.002]
    assert [(psd.size_y, psd.size_z) for psd in sensor.psds] == [(12, 14), (15, 15), (12, 14)]
    assert [psd.azimuth for psd in sensor.psds] == [psd.azimuth for psd in Sensor().psds]


def test_motions_come_in_code_units_and_order(write):
    motions = load(
        write(
            """
motions:
  s: {kind: steps, from: {tx_mm: -1}, to: {yaw_mrad: 2, by_mm: 3}, steps: 3, samples_per_step: 4}
  w: {kind: sweep, to: {roll_mrad: 5}, samples: 7, rate_hz: 50}
  i: {kind: sine, amplitude: {tz_mm: 1}, cycles: {tz_mm: 2}, phase_deg: {tz_mm: 90}}
  r: {kind: random, centre: {tx_mm: 1}, box: {pitch_mrad: 8}, samples: 9}
"""
        )
    ).motions
    zero = (0.0,) * 8
    assert [*motions.items()] == [
        ("s", Steps((-1, 0, 0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 0.002, 0, 3), 3, 4, 1000)),
        ("w", Sweep(zero, (0, 0, 0, 0.005, 0, 0, 0, 0), 7, 50)),
        (
            "i",
            Sine(
                centre=zero,
                amplitude=(0, 0, 1, 0, 0, 0, 0, 0),
                cycles=(1, 1, 2, 1, 1, 1, 1, 1),
                phase=(0, 0, math.pi / 2, 0, 0, 0, 0, 0),
                samples=1000,
                rate=1000,
            ),
        ),
        ("r", Random((1, 0, 0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0.008, 0, 0, 0), 9, 1000)),
    ]


def test_the_fingerprint_follows_values_and_motion_order_not_spelling(write):
    def sha256(text):
        return load(write(text)).sha256

    power = sha256("sensor: {beam: {power_mw: 1}}")
    assert sha256("# note\nsensor:\n  beam:\n    power_mw: 1.0\n") == power
    assert sha256("sensor: {beam: {power_mw: 1.1}}") != power
    a, b = "a: {kind: random}", "b: {kind: sweep}"
    assert sha256(f"motions: {{{a}, {b}}}") != sha256(f"motions: {{{b}, {a}}}")


# ---- extends


def test_files_are_found_from_the_file_that_names_them(write):
    table = write("tx_mm\n0\n", "base/poses.csv")
    write("motions: {t: {kind: table, file: poses.csv}}", "base/lab.yaml")
    write("extends: lab.yaml\nsensor: {beam: {diameter_mm: 1}}", "base/mine.yaml")
    config = load(write("extends: base/mine.yaml\n"))
    assert config.sensor.beam.diameter_x == 1
    assert config.motions["t"] == Table(table.resolve(), 1, 1000)


def test_motions_are_changed_replaced_and_taken_away(write):
    text = """
extends: paper
motions:
  x-steps: {kind: random, samples: 5}   # another kind: replaced whole
  yaw-sweep: {samples: 11}              # changed
  multi-axis:                           # taken away
"""
    motions = load(write(text)).motions
    assert list(motions) == ["x-steps", "yaw-sweep"]
    assert motions["x-steps"] == Random((0.0,) * 8, (0.0,) * 8, 5, 1000)
    assert motions["yaw-sweep"].samples == 11
    assert motions["yaw-sweep"].stop == load("paper").motions["yaw-sweep"].stop


def test_of_several_the_later_override_the_earlier(write):
    write("extends: skewed\nsensor: {beam: {power_mw: 1}}\n", "one.yaml")
    write("sensor: {beam: {power_mw: 2, diameter_mm: 3}}\n", "two.yaml")
    config = load(write("extends: [one.yaml, two.yaml]\nsensor: {beam: {diameter_mm: 4}}\n"))
    assert (config.sensor.beam.power, config.sensor.beam.diameter_x) == (2, 4)
    assert config.sensor.facets == load("skewed").sensor.facets


def test_a_part_without_a_value_is_taken_away(write):
    config = load(write("extends: parts\noptimize: {parts: {psds: {square-4: }}}\n"))
    assert "square-4" not in config.layout.psds
    assert "square-10" in config.layout.psds


def test_a_sensor_is_written_back_as_it_was_read(write):
    config = load("skewed")
    keys, sensor = config.resolved["sensor"], config.sensor
    assert write_sensor(keys, sensor) == keys
    first, *others = sensor.psds
    first = replace(first, correction=Correction(0.02, 1e-3, y=(3e-3,) * 9, z=(5e-3,) * 9))
    beam = replace(sensor.beam, tilt_y=0.003)
    changed = write_sensor(keys, replace(sensor, beam=beam, psds=(first, *others)))
    assert changed["beam"].pop("tilt_mrad")[1] == pytest.approx(3)
    correction = changed["psd"]["a"].pop("correction")
    expected = {"power_percent": 2, "dark_uw": 1, "y_um": [3] * 9, "z_um": [5] * 9}
    for name, value in expected.items():
        assert correction[name] == pytest.approx(value)
    del keys["beam"]["tilt_mrad"], keys["psd"]["a"]["correction"]
    assert changed == keys


def test_a_circle_of_extends_is_an_error(write):
    write("extends: my.yaml\n", "other.yaml")
    (line,) = problems(write("\nextends: other.yaml\n"))
    assert line.startswith("other.yaml:1: extends: the files extend each other in a circle: ")
    assert "my.yaml -> other.yaml -> my.yaml" in line


def test_a_wrong_value_inherited_is_reported_where_it_stands(write):
    write("sensor:\n  beam:\n    power_mw: -1\n", "base.yaml")
    lines = problems(write("extends: base.yaml\nsensor: {beam: {rotation_deg: 999}}\n"))
    assert len(lines) == 2
    assert any(line.startswith("base.yaml:3: sensor.beam.power_mw: is out of") for line in lines)
    assert any(line.startswith("my.yaml:2: sensor.beam.rotation_deg: is out") for line in lines)


# ---- errors

#: A file, and what is said of it after its name.
WRONG = [
    ("extends: papr", "1: extends: papr: no such file.*did you mean 'paper'"),
    ("\nextends: {a: 1}", "2: extends: must be a shipped name or a path.*list"),
    ("sensor:\n  beam:\n    power_mw: '0.3'", "3: sensor.beam.power_mw: .*not text.*quotes"),
    ("sensor: {beam: {power_mw: .nan}}", "1: sensor.beam.power_mw: .*finite.*got .nan"),
    (f"sensor: {{beam: {{power_mw: 1{400 * '0'}}}}}", "1: sensor.beam.power_mw: .*out of range"),
    ("sensor: {beam: {power_mw: }}", "1: sensor.beam.power_mw: .*has no value"),
    ("sensor: {beam: {power_mw: 1_0}}", "1: sensor.beam.power_mw: .*no underscores.*1_0"),
    ("sensor: {beam: {power_mw: 2001-13-45}}", "1: sensor.beam.power_mw: not a value"),
    (f"sensor: {{beam: {{power_mw: {'9' * 5000}}}}}", "1: sensor.beam.power_mw: not a value"),
    ("sensor: {beam: {power_mw: [1, 2]}}", "1: .*must be one number, not a list"),
    ("sensor:\n  beam:\n    power_mw: 1\n    power_mw: 2",
     "4: sensor.beam.power_mw: given twice, first in line 3"),
    ("sensor:\n  psd:\n    size_mm:\n    - 13\n    - 0", "5: sensor.psd.size_mm\\[1\\]: .*got 0"),
    ("sensor:\n  psd:\n    b: {yaw_mrad: 4000}", "3: sensor.psd.b.yaw_mrad: .*-3142 to 3142"),
    ("sensor: {psd: {a: {correction: {y_um: [1]}}}}", "1: .*must be 9 numbers"),
    ("\nsensr: 3", "2: sensr: unknown key.*did you mean 'sensor'"),
    ("sensor:\n  beam:\n    power:\n      1", "3: sensor.beam.power: .*mean 'power_mw'"),
    ("sensor: {beam: {optimize: 3}}", "1: sensor.beam.optimize: .*at the file's top level"),
    ("motions: {m: {samples: 3}}", "1: motions.m.kind: is missing.*sweep"),
    ("motions: {m: {kind: swep}}", "1: motions.m.kind: .*mean 'sweep'.*\"swep\""),
    ("motions: {m: {kind: table, file: no.csv}}", "1: motions.m.file: .*no such file.*no.csv"),
    ("motions: {m: {kind: steps, steps: 2.5}}", "1: motions.m.steps: .*whole number.*2.5"),
    ("motions: {a b: {kind: sweep}}", "1: motions.a b: .*letters, digits"),
    ("simulate:\n  seed: -1", "2: simulate.seed: .*whole number from 0"),
    ("simulate: {noise: on}", "1: simulate.noise: .*got \"on\""),
    ("solve: {beam: fre}", "1: solve.beam: .*did you mean 'free'"),
    ("solve: {method: paper,\n beam: prior}", "2: solve.beam: .*`method: paper`.*free"),
    ("stage: {force_n: 76}", "1: stage.force_n: .*stage.permit and stage.heartbeat.*up to 75"),
    ("stage: {mass_kg: 8, permit: board}", "1: stage.mass_kg: .*78.5 N needs stage.heartbeat;"),
    ("sensor: {light: {strips_um: [-1, 0, 0]}}", "1: sensor.light.strips_um: .*below zero"),
    ("sensor: {beam: {diameter_mm: 1000}}", "1: sensor.beam.diameter_mm: .*got 1000"),
    ("sensor: {light: {background_uw: [-200, 0, 0]}}",
     "1: sensor.light.background_uw: .*no light on PSD a at"),
    ("sensor: {apertures: {tip_um: 9000, gap_um: 9000}}",
     "1: sensor.apertures.tip_um: .*together with sensor.apertures.gap_um \\(my.yaml:1"),
    ("sensor: {imperfections: {wavefront_radius_mm: 20000}}",
     "1: sensor.imperfections.wavefront_radius_mm: .*sensor.light"),
    ("sensor:\n  imperfections:\n    tip_um2: 0\n    background_uw: [0, 0.1, 0]",
     "4: sensor.imperfections.background_uw: .*sensor.light"),
    ("sensor: {imperfections: on}", "1: sensor.imperfections: unknown key"),
    ("sensor: {temperature: {reference_c: 293.15}}",
     "1: sensor.temperature.reference_c: .*out of range.*-60 to 150 degC"),
    ("sensor: {light: {tip_um2: 1e6}}", "1: sensor.light.tip_um2"),
    ("sensor: {light: {rolloff_width_um: 300}}", "1: sensor.light.rolloff_width_um"),
    # the YAML itself
    ("", "1: is empty; a configuration is made of `key: value` lines"),
    ("- 1", "1: .*`key: value`"),
    ("sensor:\n  beam: {power_mw: 1\n  x: 3", "3: .*comma or a closing bracket"),
    ("sensor:\n\tbeam: 1", "2: .*indent with spaces"),
    ("sensor: \n  beam: {}\n mirror: {}", "3: .*check the indentation"),
    ("a: *x", "1: .*undefined alias"),
    ("a: 1\n---\nb: 2", "2: .*another document"),
    ("a: 1\nb: !!python/object:os.system x", "2: .*leave the tag"),
    ("a: &x [*x]", "1: .*contains itself"),
    ("a: 1\n<<: {b: 1}", "2: .*use `extends`"),
    # a sub-beam that misses its detector
    ("sensor:\n  mirror:\n    a: {inclination_deg: 49}",
     "3: sensor.mirror.a.inclination_deg: at the nominal pose the sub-beam of facet a lands at "
     "psi 0, zeta -35.4 mm, 28.9 mm beyond .*got 49"),
    ("sensor:\n  beam:\n    tilt_mrad: [0, 50]",
     r"3: sensor.beam.tilt_mrad: .*facet a .*facet b .*facet c .*got \[0, 50\]"),
    # of two keys off the usual, the one that matters
    ("sensor:\n  psd: {a: {radius_mm: 240, pitch_mrad: 9}}\n  mirror: {inclination_deg: 49}",
     "3: sensor.mirror.inclination_deg: .*facet a .*facet b .*facet c .*got 49"),
    ("sensor: {psd: {yaw_mrad: 3000}}",
     "1: sensor.psd.yaw_mrad: .*never reaches the front of its PSD.*got 3000"),
    ("sensor:\n  mirror:\n    b: {azimuth_deg: 240}\n    c: {azimuth_deg: 120}",
     "3: sensor.mirror.b.azimuth_deg: azimuth of facet .*make a pyramid.*with sensor.mirror.c"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "says"), WRONG)
def test_a_wrong_key_is_named_with_file_and_line(write, text, says):
    (message,) = problems(write(text and text + "\n"))
    assert re.match(f"my.yaml:{says}", message), message


def test_a_strong_stage_with_a_permit_and_a_heartbeat_is_right(write):
    strong = "{force_n: 500, mass_kg: 20, permit: board, heartbeat: board}"
    assert load(write(f"stage: {strong}")).stage.force == 500


def test_all_problems_of_a_file_come_at_once_and_in_its_order(write):
    text = "solve: {beam: x}\nsensor:\n  beam: {power_mw: 0}\n  psds: 3\nsimulate: {seed: a}\n"
    assert [line.split(": ")[0] for line in problems(write(text))] == [
        f"my.yaml:{n}" for n in (1, 3, 4, 5)
    ]


def test_text_that_is_not_utf8_is_an_error_with_its_line(write):
    path = write("a: 1")
    path.write_bytes(b"a: 1\nb: \xff\n")
    (message,) = problems(path)
    assert message.startswith("my.yaml:2: not UTF-8")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("papr", "did you mean 'paper'.*shipped names: bench, bench-drift, bench-light, catalogue"),
        ("nothere.yaml", "no such file"),
        ("my", "did you mean 'my.yaml'. The name of a file needs its ending"),
        (".", "folder"),
        ("x" * 300, "too long"),
    ],
)  # fmt: skip
def test_a_missing_file_lists_what_there_is(write, name, says):
    write("a: 1")
    with pytest.raises(ConfigError, match=f"(?s){says}"):
        load(name)


# ---- errors that arise from several keys, of several files

#: Keys of base.yaml, those of the file that extends it, and what is said.
CONFLICTS = [
    ("sensor: {light: {wavelength_nm: 600}}", "sensor: {apertures: {tip_um: 10}}",
     "my.yaml:2: sensor.apertures.tip_um: light.wavelength is given with apertures"),
    ("sensor: {light: {strips_um: [50, 0, 0]}}", "sensor: {beam: {diameter_mm: 0.1}}",
     r"my.yaml:2: sensor.beam.diameter_mm: .*not small compared with.*strips_um \(base.yaml:2"),
    ("solve: {beam: known}", "solve: {method: paper}",
     r"my.yaml:2: solve.method: .*solve.beam \(base.yaml:2\)"),
    ("optimize: {variables: {size_mm: [1, 10]}}", "optimize: {parts: {psds: {x: {size_mm: 4}}}}",
     r"my.yaml:2: optimize.parts.psds: .*optimize.variables.size_mm \(base.yaml:2\)"),
    ("sensor: {psd: {a: {radius_mm: 240}}}", "sensor: {mirror: {inclination_deg: 49}}",
     "my.yaml:2: sensor.mirror.inclination_deg: .*facet a .*facet b .*facet c "),
    # only the extended file is wrong
    ("sensor: {mirror: {inclination_deg: 49}}", "sensor: {psd: {a: {pitch_mrad: 9}}}",
     "base.yaml:2: sensor.mirror.inclination_deg: .*facet a .*facet b .*facet c "),
]  # fmt: skip


@pytest.mark.parametrize(("below", "own", "says"), CONFLICTS)
def test_an_error_of_several_keys_names_the_key_of_the_file_that_was_asked_for(
    write, below, own, says
):
    write(f"extends: paper\n{below}\n", "base.yaml")
    (message,) = problems(write(f"extends: base.yaml\n{own}\n"))
    assert re.match(says, message), message


def test_an_estimate_of_a_strip_may_be_below_zero(write):
    matrix = "parameter,sensor.light.strip_ca\n"
    path = write(matrix, "covariance.csv")
    text = "sensor: {light: {strips_um: [-1, 0, 0]}, calibration: {file: covariance.csv}}"
    assert not any("below zero" in line for line in problems(write(text)))
    path.unlink()


def keys_of(path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """All keys of a configuration that are no blocks."""
    inner = key_names(path)
    return [key for name in inner for key in keys_of((*path, name))] if inner else [path]


@pytest.mark.slow
def test_an_absurd_value_of_any_key_is_blamed_on_that_key_and_file(write):
    blamed = []
    for path in keys_of():
        lines = [f"{'  ' * depth}{key}:" for depth, key in enumerate(path)]
        value = "1000" if path[:2] in (("sensor", "beam"), ("sensor", "psd")) else "1e9"
        try:
            load(write("\n".join(["extends: paper", *lines]) + f" {value}\n"))
        except ConfigError as error:
            for line in str(error).splitlines():
                blamed.append(path)
                assert line.startswith(f"my.yaml:{len(path) + 1}: {'.'.join(path)}"), line
    assert len(blamed) > 150


def test_a_rig_turned_as_a_whole_is_right(write):
    turned = ", ".join(f"{name}: {{azimuth_deg: {30 + 120 * k}}}" for k, name in enumerate("abc"))
    load(write(f"sensor: {{mirror: {{{turned}}}, psd: {{{turned}}}}}"))


# ---- the schema


def numbers(node: dict) -> list[dict]:
    """The numbers that a key may hold, each with its range."""
    inner = [*node.get("anyOf", []), *node.get("prefixItems", [])]
    inner += [node["items"]] if "items" in node else []
    own = [node] if node.get("type") in ("number", "integer") else []
    return own + [number for part in inner for number in numbers(part)]


def test_every_key_of_the_schema_has_a_description_and_every_number_a_range():
    blocks = {"Document": schema(), **schema()["$defs"]}
    seen = 0
    for block, node in blocks.items():
        assert node["additionalProperties"] is False, block
        for name, key in node["properties"].items():
            assert key.get("description") or key.get("const"), (block, name)
            for number in numbers(key):
                seen += 1
                assert {"minimum", "exclusiveMinimum"} & set(number), (block, name)
                assert {"maximum", "exclusiveMaximum"} & set(number), (block, name)
    assert seen > 60


def test_every_number_has_a_unit_in_its_name_or_is_a_count():
    # the last ones: of an auxiliary channel in its own unit, of a goal, in a controller's own units
    counts = """
        steps samples_per_step samples seed max_steps detectors poses runs periods snr condition
        adc_bits baud gain integral dark_counts starts search_reversals degrees_of_freedom index
        profile asymmetry stains scale offset outliers price resolution mean_resolution range size
        native_limits
    """.split()  # noqa: SIM905
    words = ("_seconds", "_weeks", "_per_hour", "_ratio", "_kg", "_hpa")
    for block, node in schema()["$defs"].items():
        for name, key in node["properties"].items():
            is_clear = unit_in(name) or name.endswith(words) or name in counts
            assert not numbers(key) or is_clear, (block, name)


def test_the_schema_lets_an_editor_pass_what_a_file_may_inherit_or_leave_empty():
    defs = schema()["$defs"]
    assert all("required" not in block for block in defs.values())
    assert all("null" in block["type"] for block in defs.values())
    (motion,) = schema()["properties"]["motions"]["patternProperties"].values()
    assert {"$ref": "#/$defs/Sweep"} in motion["anyOf"]
    assert "oneOf" not in motion  # {samples: 3} fits several kinds


def test_aliases_that_multiply_are_refused(tmp_path):
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 12)]
    path = tmp_path / "many.yaml"
    path.write_text("\n".join(lines))
    with pytest.raises(ConfigError, match=r"many\.yaml:5: a4: more than 20,000 values"):
        load(path)


def test_files_that_are_extended_twice_are_read_once_and_a_chain_has_an_end(write):
    write("extends: paper\n", "0.yaml")
    for n in range(1, 80):
        write(f"extends: [{n - 1}.yaml, {n - 1}.yaml]\n", f"{n}.yaml")
    assert load("39.yaml").sha256 == load("paper").sha256
    with pytest.raises(ConfigError, match=r":1: extends: more than 50 files in all"):
        load("79.yaml")


def test_a_file_that_is_too_long_is_refused(write):
    with pytest.raises(ConfigError, match="bytes; a configuration has at most"):
        load(write(f"# {'x' * 1_000_000}"))
