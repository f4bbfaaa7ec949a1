"""Axis tests: the formulas of ISO 230-2 beside numbers worked by hand, error motions beside rigid
bodies that scipy moves, and stands beside the commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from commands import command
from scipy.spatial.transform import Rotation

import facets
from facets import InputError
from facets.characterization import (
    QUANTITIES,
    Commands,
    ErrorMotions,
    PoseSeries,
    Visits,
    approach_directions,
    evaluate_axis,
    evaluate_positioning,
    find_disturbances,
    find_visits,
    match_stands,
    measure_error_motions,
    measured_directions,
    read_commands,
    read_series,
    recorded_series,
)
from facets.core import STATE_COLUMNS, STATE_UNITS, Knowledge
from facets.estimation import make_plan
from facets.files import write_table

SENSOR = facets.load("paper").sensor
KNOWN = Knowledge(beam="known")

#: Two targets, three runs, um. Means: 1, 5 up and -3, 2 down; s: 1, 2 up and 2, 1 down.
WORKED = np.array([[[0.0, 1, 2], [-5, -3, -1]], [[3, 5, 7], [1, 2, 3]]])
BY_HAND = {
    "B": 4.0,  # 1 + 3 and 5 - 2
    "B_mean": 3.5,
    "R_up": 8.0,
    "R_down": 8.0,
    "R": 10.0,  # 2 * 1 + 2 * 2 + 4, beside 2 * 2 + 2 * 1 + 3 = 9
    "E_up": 4.0,
    "E_down": 5.0,
    "E": 8.0,  # from -3 to 5
    "M": 4.5,  # from -1 to 3.5
    "A_up": 10.0,  # from 1 - 2 to 5 + 4
    "A_down": 11.0,  # from -3 - 4 to 2 + 2
    "A": 16.0,  # from -7 to 9
}


def values(x: np.ndarray) -> dict[str, float]:
    return {symbol: float(formula(x)) for _, symbol, formula in QUANTITIES}


def test_quantities_are_those_worked_by_hand():
    assert values(WORKED) == pytest.approx(BY_HAND)


def test_what_a_test_lacks_is_not_a_number():
    up = WORKED.copy()
    up[:, 1] = np.nan
    found = values(up)
    assert (found["E_up"], found["A_up"]) == (4, 10)
    assert all(np.isnan(found[name]) for name in ("B", "B_mean", "R", "E", "M", "A", "A_down"))
    once = values(WORKED[:, :, :1])
    assert (once["E"], np.isfinite(once["M"])) == (8, True)
    assert all(np.isnan(once[name]) for name in ("R_up", "R", "A_up", "A"))
    up[0, 1] = WORKED[0, 1]  # the last target alone was approached from below only
    found = {q.symbol: q for q in evaluate_positioning(up, np.zeros((3, 2, 2, 3)))}
    assert (found["B"].value, found["A"].value, found["A"].expanded) == (4, 16, 0)


def test_expanded_uncertainties_hold_where_the_sensor_errs_more_than_the_axis():
    """The bound is 4 standard deviations of a count of 80. Of axes that err by more, and of how
    wide an uncertainty is at most, `experiments/axis_tests.py` has its tests."""
    rng, inside = np.random.default_rng(2), []
    target = np.arange(7)[:, None]
    together = np.linalg.cholesky(0.3 * np.exp(-np.square(target - target.T) / 9)
                                  + 1e-9 * np.eye(7))  # fmt: skip
    for _ in range(80):
        noise = rng.standard_normal((101, 7, 2, 3))
        noise += (rng.standard_normal((101, 7)) @ together.T)[:, :, None, None]
        found = evaluate_positioning(noise[0], noise[1:])
        inside.append([abs(q.value) <= q.expanded for q in found])
    shares = dict(zip(BY_HAND, np.mean(inside, axis=0), strict=True))
    assert min(shares.values()) > 0.85, shares


def visits(states: np.ndarray, targets: np.ndarray) -> Visits:
    count = len(targets)
    zero = np.zeros(count, dtype=int)
    return Visits(
        targets, np.arange(count), zero, zero, np.arange(count) * 1.0,
        np.hstack([states, np.zeros((count, 2))]), np.full(count, 1e9), np.ones(6),
    )  # fmt: skip


def test_a_linear_axis_has_the_errors_that_a_rigid_body_was_given():
    """At a point 40 mm from the apex, along a skew direction, in axes of the object's own."""
    body = facets.MeasuredObject((10, -5, 40), (0.0, 0.0, np.pi / 6))
    own, point = Rotation.from_euler("z", np.pi / 6), np.array([10.0, -5, 40])
    way = np.linspace(-0.2, 0.2, 9)
    bow = 1 - (way / 0.2) ** 2
    skew = Rotation.from_rotvec([0, 2e-3, -3e-3])  # of the axis to the object's x
    errors = np.stack([1e-3 * way, 2e-3 * bow, -1e-3 * bow, *(1e-5 * n * bow for n in (1, 2, 3))])
    shift = own.apply(skew.apply(errors[:3].T + np.outer(way, [1, 0, 0])))
    turn = own * skew * Rotation.from_rotvec(errors[3:].T) * skew.inv() * own.inv()
    places = point + shift - turn.apply(point)
    states = np.hstack([places, turn.as_euler("xyz")])
    found = measure_error_motions(SENSOR, KNOWN, visits(states, way), "X", body)
    assert found.names == ["EXX", "EYX", "EZX", "EAX", "EBX", "ECX"]
    expected = errors - errors.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(found.values[:, :, 0, 0], expected, atol=2e-8)
    np.testing.assert_allclose(found.frame[0], skew.as_matrix()[:, 0], atol=1e-6)
    ends = measure_error_motions(SENSOR, KNOWN, visits(states, way), "X", body, "end-points")
    np.testing.assert_allclose(ends.values[1, :, 0, 0], errors[1], atol=2e-8)
    given = measure_error_motions(SENSOR, KNOWN, visits(states, way), "X", body, "nominal")
    np.testing.assert_allclose(given.values[0, :, 0, 0], expected[0], atol=2e-8)  # no cosine
    slope = np.polyfit(way, given.values[1, :, 0, 0], 1)[0]
    assert slope == pytest.approx(-3e-3, rel=0.01)


def test_a_rotary_axis_beside_the_apex_has_no_error_but_its_own():
    angle = np.linspace(-0.012, 0.012, 9)
    tilt, where = Rotation.from_rotvec([1e-3, -2e-3, 0]), np.array([0.3, -0.2, 0.0])
    wobble = 5e-6 * np.sin(300 * angle)
    turn = tilt * Rotation.from_rotvec(np.outer(angle + wobble, [0, 0, 1])) * tilt.inv()
    lift = 4e-4 * (1 - (angle / 0.012) ** 2)
    places = where - turn.apply(where) + np.outer(lift, tilt.as_matrix()[:, 2])
    states = np.hstack([places, turn.as_euler("xyz")])
    found = measure_error_motions(SENSOR, KNOWN, visits(states, angle), "C")
    assert found.names[5] == "ECC"
    expected = np.zeros((6, 9))
    expected[2], expected[5] = lift - lift.mean(), wobble - wobble.mean()
    np.testing.assert_allclose(found.values[:, :, 0, 0], expected, atol=2e-8)
    np.testing.assert_allclose(found.offset[:2], where[:2], atol=1e-3)


def series(commands: np.ndarray, rng: np.random.Generator, rows: int = 200) -> PoseSeries:
    """An axis along z that goes to its positions, 3 mm from the table's zero."""
    way = np.repeat(commands + 3 + rng.normal(0, 1e-4, len(commands)), 2)
    knots = np.cumsum(np.tile([60, rows], len(commands)))
    z = np.interp(np.arange(knots[-1]), knots, way)
    states = np.zeros((len(z), 8))
    states[:, 2] = z
    states[:, :6] += 1e-6 * rng.standard_normal((len(z), 6))
    return PoseSeries(np.arange(len(z)) * 1e-3, states, np.zeros(len(z), bool))


UP_AND_DOWN = np.array([0, 1, 2, 3, 3, 2, 1, 0.0])


def found_visits(poses: PoseSeries, commands: np.ndarray | None, axis: str = "Z"):
    known = None if commands is None else Commands(commands, approach_directions(commands))
    return find_visits(poses, axis, known, SENSOR, make_plan(SENSOR, KNOWN), shortest_s=0.1)


def test_stands_are_matched_with_commands_though_some_lack_and_some_are_stray():
    rng = np.random.default_rng(4)
    way = np.array([7, 0, 1, 2, 3.4, 3, 2, 1, 0, 1, 2])  # 3 was reached once, 7 was not commanded
    poses = series(way, rng)
    poses.states[300:310] = np.nan
    poses.misfit[400:403] = True
    found, counts = found_visits(poses, np.array([0, 1, 2, 3, 3, 2, 1, 0, 1, 2, 2.0]))
    assert (counts.stray_stands, list(counts.missing)) == (1, [2.0])
    assert (counts.unsolved, counts.misfits) == (10, 3)
    np.testing.assert_array_equal(found.targets[found.target], [0, 1, 2, 3, 3, 2, 1, 0, 1, 2])
    np.testing.assert_array_equal(found.direction, [0, 0, 0, 0, 1, 1, 1, 1, 0, 0])
    np.testing.assert_array_equal(found.run, [0] * 8 + [1, 1])


def test_without_commands_the_stands_are_equally_spaced():
    rng = np.random.default_rng(5)
    way = np.array([0, 1, 2, 3, 4, 2.99, 1.99, 0.99, -0.01, 1, 2, 3])
    poses = series(way, rng)
    found, _ = found_visits(poses, None)
    assert len(found.targets) == 5
    np.testing.assert_allclose(np.diff(found.targets), 1, atol=0.01)
    np.testing.assert_array_equal(found.direction, [0, 0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0])
    with pytest.raises(InputError, match="not equally spaced"):
        match_stands(np.array([0, 1, 2.5, 0, 1, 2.5]), None)
    notes = evaluate_axis(SENSOR, KNOWN, poses, "Z", shortest_s=0.1).notes()
    assert any("An error of scale cannot be seen" in note for note in notes)


def test_what_cannot_be_a_test_of_the_axis_is_refused():
    poses = series(UP_AND_DOWN, np.random.default_rng(6))
    with pytest.raises(InputError, match=r"moved .* along Z; name the axis that moved"):
        found_visits(poses, UP_AND_DOWN, "X")
    with pytest.raises(InputError, match=r"stands still . times"):
        found_visits(replace(poses, states=np.tile(poses.states[:1], (len(poses.time), 1))), None)
    for scale in (1000, 1 / 1000, 0.5, 1.25, 2):  # of 2: diameters
        with pytest.raises(InputError, match="check the unit"):
            found_visits(poses, scale * UP_AND_DOWN)
    leaning = replace(poses, states=poses.states.copy())
    leaning.states[:, 0] = np.tan(np.radians(11)) * poses.states[:, 2]
    with pytest.raises(InputError, match=r"leans by 11 degrees from the object's Z; allowed: 10"):
        evaluate_axis(SENSOR, KNOWN, leaning, "Z", shortest_s=0.1)
    for missing in (2, 5):  # a pose that lacks one number is missing, too
        nothing = replace(poses, states=poses.states.copy())
        nothing.states[:, missing] = np.nan
        with pytest.raises(InputError, match="no row has a pose"):
            found_visits(nothing, UP_AND_DOWN)


def test_a_table_of_commands_is_checked(tmp_path):
    table = tmp_path / "commands.csv"

    def read(text, axis="Z"):
        table.write_text(text)
        return read_commands(table, axis)

    for text, words in (
        ("position_deg\n1\n2\n", "needed for the axis Z: one of position_mm, position_um"),
        ("position_mm,direction\n1,1\n2,0\n", "row 2: direction is 0"),
        ("position_mm,direction\n1,1\n2,-1\n1,1\n", "direction contradicts the order"),
        ("position_mm\n1\n\nx\n", "not a number"),
    ):
        with pytest.raises(InputError, match=words):
            read(text)
    assert read("position_deg\n1\n2\n", "C").positions[1] == pytest.approx(np.radians(2))
    overrun = read("position_mm,direction\n1,-1\n2,-1\n3,-1\n")  # at each position
    assert overrun.direction.tolist() == [1, 1, 1]


def test_a_recording_and_a_table_have_the_same_poses(tmp_path):
    states = np.array([[0.1, -0.2, 3, 1, 2, -4, 0.01, 0.02], [np.nan] * 8])
    columns = dict(zip(STATE_COLUMNS, states.T, strict=True))
    columns |= {"host_s": np.array([7.0, 7.5]), "misfit": np.array([0, 3])}
    poses = recorded_series(columns)
    np.testing.assert_array_equal(poses.time, [0, 0.5])
    np.testing.assert_allclose(poses.states[0], states[0] * [1, 1, 1, 1e-3, 1e-3, 1e-3, 1, 1])
    assert np.isnan(poses.states[1]).all()
    assert poses.misfit.tolist() == [False, True]
    write_table(tmp_path / "poses.csv", columns, {})
    for again, expected in zip(
        vars(read_series(tmp_path / "poses.csv")).values(), vars(poses).values(), strict=True
    ):
        np.testing.assert_array_equal(again, expected)


def test_the_command_writes_what_it_found(tmp_path):
    """An axis with a backlash of 4 um, tested three times in each direction."""
    import pandas

    way = np.tile([-1, 0.002, 1.002, 2.002, 3.002, 4, 2.998, 1.998, 0.998, -0.002], 3)
    poses = series(way, np.random.default_rng(7))
    columns = dict(zip(STATE_COLUMNS, (poses.states / STATE_UNITS).T, strict=True))
    write_table(tmp_path / "poses.csv", columns | {"time_s": poses.time}, {})
    positions = np.tile(UP_AND_DOWN, 3)
    write_table(tmp_path / "commands.csv", {"position_mm": positions}, {})
    write_table(tmp_path / "more.csv", {"position_mm": np.append(positions, 3)}, {})
    words = ("axis", "poses.csv", "--config", "paper", "--axis", "Z", "--dwell", "0.1")
    given = (*words, "--commands", "commands.csv", "-d", "out")
    result = command(*given, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "EZZ: 24 stands at 4 positions" in result.stdout
    assert "runs at a position are 3 in the positive" in result.stdout
    quantities = pandas.read_csv(tmp_path / "out/quantities.csv", comment="#")
    main = quantities[quantities.error == "EZZ"].set_index("symbol")
    for symbol, true in {"B": 4, "B_mean": 4, "E": 4}.items():
        assert main.value[symbol] == pytest.approx(true, abs=0.3)
    lines = (tmp_path / "out/compensation.csv").read_text().splitlines()
    assert lines[0] == "Z,EXZ,EYZ,EZZ,EAZ,EBZ,ECZ"
    assert [float(line.split(",")[0]) for line in lines[1:]] == [0, 1, 2, 3]
    page = (tmp_path / "out/axis.html").read_text()
    assert "bidirectional accuracy" in page
    assert "<svg" in page
    record = (tmp_path / "out/run.yaml").read_text()
    assert "actual less commanded" in record
    assert "config_sha256" in record
    assert command(*given, cwd=tmp_path).returncode == 2  # the results exist
    more = command(*words, "--commands", "more.csv", "-d", "more", cwd=tmp_path)
    assert more.returncode == 1
    assert "Commanded positions without a stand: 1, the first at" in more.stdout
    assert not (tmp_path / "more/compensation.csv").exists()


def test_wrong_input_is_named(run_in_process, tmp_path):
    (tmp_path / "poses.csv").write_text(
        "time_s,tx_mm,ty_mm,tz_mm,roll_mrad,pitch_mrad,yaw_mrad\n"
        "0,0,0,0,0,0,0\n1,0,0,1,0,0,0\n1,0,0,1,0,0,0\n"
    )
    for words, message in (
        (("poses.csv",), "give the configuration of the sensor"),
        (("poses.csv", "--config", "paper"), "row 3: time_s is 1; the times of all rows"),
        (("none.csv", "--config", "paper"), "none.csv: no such file"),
    ):
        status, _, errors = run_in_process("axis", *words, "--axis", "Z")
        assert status == 2
        assert message in " ".join(errors.split())
    assert not (tmp_path / "results").exists()


def test_stands_far_off_and_a_drift_there_and_back_are_named_and_left_out():
    commands = Commands(np.tile(UP_AND_DOWN, 5), np.tile(np.repeat([0, 1], 4), 5))
    way = np.tile([-1, 0, 1, 2, 3, 4, 3, 2, 1, 0], 5)  # -1 and 4 are no commands
    clean = series(way, np.random.default_rng(8))
    poses = replace(clean, states=clean.states.copy())
    poses.states[:, 2] += 3e-3 * np.sin(np.pi * poses.time / poses.time[-1])
    for stand, axis, size in ((12, 2, 0.015), (13, 2, 0.012), (27, 4, 1e-4)):
        poses.states[260 * stand : 260 * (stand + 1), axis] += size
    report = evaluate_axis(SENSOR, KNOWN, poses, "Z", commands, shortest_s=0.1)
    assert report.disturbances.is_far.sum() == 3
    assert np.flatnonzero(report.drifts).tolist() == [2]
    assert abs(report.drifts[2]) == pytest.approx(3e-3, rel=0.2)
    notes = " ".join(report.notes())
    assert "at 1 mm (3.28 s), EZZ by +14.6 µm; at 2 mm (3.539 s), EZZ by +11.7 µm; at 2" in notes
    assert "(7.179 s), EBZ by +100 µrad" in notes
    assert "the axis or its encoder warmed up" in notes
    assert "no calibration of the sensor" in notes
    alone = evaluate_axis(SENSOR, KNOWN, clean, "Z", commands, shortest_s=0.1)
    assert alone.undisturbed is None
    for n in (0, 1, 4, 7, 11):  # B, B_mean, R, E and A
        true, found = alone.quantities[2][n].value, report.undisturbed.quantities[2][n]
        assert found.value == pytest.approx(true, abs=1.5 * found.expanded)
        assert report.quantities[2][n].value > true + 10 * found.expanded
    errors = [float(line.split(",")[3]) for line in report.compensation().splitlines()[1:]]
    np.testing.assert_allclose(errors, 1e3 * alone.means[2], atol=0.1)


def test_the_scatter_of_an_axis_is_neither_far_off_nor_drift():
    count = 32
    every = visits(np.zeros((count, 6)), np.arange(count))
    every = replace(every, target=np.tile(UP_AND_DOWN.astype(int), 4),
                    direction=np.tile([0] * 4 + [1] * 4, 4), run=np.arange(count) // 8)  # fmt: skip
    rng, scale = np.random.default_rng(9), np.ones((4, 4))
    for _ in range(150):
        grid = every.grid(rng.standard_normal((6, count)))
        motions = ErrorMotions("Z", UP_AND_DOWN, grid, grid[:, None], every.time, scale, scale)
        found = find_disturbances(every, motions)
        assert not found.is_far.any()
        assert not found.trend.any()


def test_of_two_stands_that_of_the_commanded_direction_belongs_to_the_command():
    """A recording that goes on beyond the last command, over the end and to its target again."""
    way = np.array([0.0, 1, 2, 3, 2, 1, 0, -1, 0, 1])
    parts = [slice(10 * n, 10 * n + 10) for n in range(10) if n not in (3, 7)]  # turns without stop
    directions = measured_directions(np.repeat(way, 10), parts)
    assert directions.tolist() == [-1, 0, 0, 1, 1, 1, 0, 0]
    places = np.delete(way, [3, 7])
    commands = Commands(places[:6], np.array([0, 0, 0, 1, 1, 1]))
    assert match_stands(places, commands, directions)[1].tolist() == [0, 1, 2, 3, 4, 5, -1, -1]
