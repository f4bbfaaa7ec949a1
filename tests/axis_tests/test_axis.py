"""Axis tests: the formulas of ISO 230-2 beside numbers worked by hand, error motions beside rigid
bodies that scipy moves, and stands beside the commands.

`experiments/studies/axis_tests.py` compares expanded uncertainties with the truth of drawn axes.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import facets
from facets import InputError
from facets.axis_tests import (
    AxisTest,
    Commands,
    PoseSeries,
    Visits,
    approach_directions,
    evaluate_axis,
    evaluate_positioning,
    find_visits,
    match_dwells,
    measure_error_motions,
    read_commands,
    read_series,
    series_of_columns,
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


def quantities(x):
    return {q.symbol: q.value for q in evaluate_positioning(x, np.zeros((3, *x.shape)))}


def test_quantities_are_those_worked_by_hand_and_of_what_lacks_not_a_number():
    assert quantities(WORKED) == pytest.approx(BY_HAND)
    up = WORKED.copy()
    up[:, 1] = np.nan
    once = WORKED[:, :, :1]
    for x, known in ((up, {"E_up", "A_up", "R_up"}),
                     (once, {"B", "B_mean", "E_up", "E_down", "E", "M"})):  # fmt: skip
        assert {symbol for symbol, value in quantities(x).items() if np.isfinite(value)} == known
    up[0, 1] = WORKED[0, 1]  # the last target alone was approached from below only
    assert (quantities(up)["B"], quantities(up)["A"]) == (4, 16)


def measure(places, turn, targets, *test):
    """The error motions of an axis that stood once at each target, and their values (6, n)."""
    order, zero = np.arange(len(targets)), np.zeros(len(targets), int)
    states = np.column_stack([places, turn.as_euler("xyz"), zero, zero])
    visits = Visits(targets, order, zero, zero, order, states, zero + 1e9, np.ones(6))
    motions = measure_error_motions(SENSOR, KNOWN, visits, AxisTest(*test))
    return motions, motions.values[:, :, 0, 0]


def test_a_linear_axis_has_the_errors_that_a_rigid_body_was_given():
    """At a point 40 mm from the apex, along a skew direction, in axes of the object's own."""
    body = facets.MeasuredObject((10, -5, 40), (0.0, 0.0, np.pi / 6))
    own, point = Rotation.from_euler("z", np.pi / 6), np.array([10.0, -5, 40])
    way = np.linspace(-0.2, 0.2, 9)
    bow = 1 - (way / 0.2) ** 2
    skew = Rotation.from_rotvec([0, 2e-3, -3e-3])  # of the axis to the object's x
    errors = np.stack([1e-3 * way, *np.outer([2e-3, -1e-3, 1e-5, 2e-5, 3e-5], bow)])
    shift = own.apply(skew.apply(errors[:3].T + np.outer(way, [1, 0, 0])))
    turn = own * skew * Rotation.from_rotvec(errors[3:].T) * skew.inv() * own.inv()
    given = point + shift - turn.apply(point), turn, way, "X", None, body
    motions, values = measure(*given)
    assert motions.names == ["EXX", "EYX", "EZX", "EAX", "EBX", "ECX"]
    expected = errors - errors.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(values, expected, atol=2e-8)
    np.testing.assert_allclose(motions.frame[0], skew.as_matrix()[:, 0], atol=1e-6)
    np.testing.assert_allclose(measure(*given, "end-points")[1][1], errors[1], atol=2e-8)
    nominal = measure(*given, "nominal")[1]
    np.testing.assert_allclose(nominal[0], expected[0], atol=2e-8)  # no cosine
    assert np.polyfit(way, nominal[1], 1)[0] == pytest.approx(-3e-3, rel=0.01)


def test_a_rotary_axis_beside_the_apex_has_no_error_but_its_own():
    angle = np.linspace(-0.012, 0.012, 9)
    tilt, where = Rotation.from_rotvec([1e-3, -2e-3, 0]), np.array([0.3, -0.2, 0.0])
    wobble, lift = 5e-6 * np.sin(300 * angle), 4e-4 * (1 - (angle / 0.012) ** 2)
    turn = tilt * Rotation.from_rotvec(np.outer(angle + wobble, [0, 0, 1])) * tilt.inv()
    places = where - turn.apply(where) + np.outer(lift, tilt.as_matrix()[:, 2])
    motions, values = measure(places, turn, angle, "C")
    expected = np.zeros((6, 9))
    expected[2], expected[5] = lift - lift.mean(), wobble - wobble.mean()
    np.testing.assert_allclose(values, expected, atol=2e-8)
    np.testing.assert_allclose(motions.offset[:2], where[:2], atol=1e-3)


def series(commands, seed, turns=()):
    """An axis along z that goes to its positions, 3 mm from the table's zero, and stands at each
    for 0.2 s, but at those where it turns."""
    rng = np.random.default_rng(seed)
    way = np.repeat(commands + 3 + rng.normal(0, 1e-4, len(commands)), 2)
    stands = np.where(np.isin(np.arange(len(commands)), turns), 1, 200)
    knots = np.cumsum(np.column_stack([0 * stands + 60, stands]).ravel())
    states = np.zeros((knots[-1], 8))
    states[:, 2] = np.interp(np.arange(knots[-1]), knots, way)
    states[:, :6] += 1e-6 * rng.standard_normal((len(states), 6))
    return PoseSeries(np.arange(len(states)) * 1e-3, states, np.zeros(len(states), bool))


UP_AND_DOWN = np.array([0, 1, 2, 3, 3, 2, 1, 0.0])


def test_stands_that_two_detectors_measured_have_their_uncertainty():
    """Without a detector the poses are less certain, in every quantity."""
    poses = series(UP_AND_DOWN, 3)
    used = np.ones((len(poses.states), 3), dtype=bool)
    used[100:, 2] = False
    commands = Commands(UP_AND_DOWN, approach_directions(UP_AND_DOWN))
    test, sizes = AxisTest("Z", commands, shortest_s=0.1), []
    for detectors in (None, used):
        report = evaluate_axis(SENSOR, KNOWN, replace(poses, used=detectors), test)
        sizes.append([value.expanded for value in report.quantities[2]])
    assert np.nanmin(np.array(sizes[1]) / np.array(sizes[0])) > 1.7


def visit(poses, commands=UP_AND_DOWN, axis="Z"):
    known = None if commands is None else Commands(commands, approach_directions(commands))
    return find_visits(
        poses, AxisTest(axis, known, shortest_s=0.1), SENSOR, make_plan(SENSOR, KNOWN)
    )


def test_stands_are_matched_with_commands_though_some_lack_and_some_are_stray():
    poses = series(np.array([7, 0, 1, 2, 3.4, 3, 2, 1, 0, 1, 2]), 4)
    poses.states[300:310] = np.nan
    poses.misfit[400:403] = True
    commands = np.array([0, 1, 2, 3, 3, 2, 1, 0, 1, 2, 2.0])  # 3 was reached once, 7 not commanded
    found, counts = visit(poses, commands)
    assert (counts.stray_dwells, counts.missing) == (1, (2.0,))
    assert (counts.unsolved, counts.misfits) == (10, 3)
    np.testing.assert_array_equal(found.targets[found.target], commands[:10])
    np.testing.assert_array_equal(found.direction, [1, 0, 0, 0, 1, 1, 1, 1, 0, 0])  # from 7
    np.testing.assert_array_equal(found.run, [0] * 7 + [1, 1, 1])


def test_without_commands_the_stands_are_equally_spaced():
    poses = series(np.array([0, 1, 2, 3, 4, 2.99, 1.99, 0.99, -0.01, 1, 2, 3]), 5)
    found, _ = visit(poses, None)
    np.testing.assert_allclose(np.diff(found.targets), [1] * 4, atol=0.01)
    np.testing.assert_array_equal(found.direction, [0] * 5 + [1] * 4 + [0] * 3)
    with pytest.raises(InputError, match="not equally spaced"):
        match_dwells(np.array([0, 1, 2.5, 0, 1, 2.5]), None, np.zeros(6, int))
    notes = evaluate_axis(SENSOR, KNOWN, poses, AxisTest("Z", shortest_s=0.1)).notes()
    assert any("An error of scale cannot be seen" in note for note in notes)


def test_what_cannot_be_a_test_of_the_axis_is_refused():
    poses = series(UP_AND_DOWN, 6)
    still, leaning, blind = (replace(poses, states=poses.states.copy()) for _ in range(3))
    still.states[:] = poses.states[0]
    leaning.states[:, 0] = np.tan(np.radians(11)) * poses.states[:, 2]
    blind.states[:, 5] = np.nan  # a pose that lacks one number is missing, too
    for words, *given in (
        ("no row has a pose", blind),
        (r"moved .* along Z; name the axis that moved", poses, UP_AND_DOWN, "X"),
        (r"is at rest . times", still, None),
        ("0.001 times", poses, 1000 * UP_AND_DOWN),
        ("2 times as far", poses, 0.5 * UP_AND_DOWN),
        ("check the unit", poses, 1.25 * UP_AND_DOWN),
    ):
        with pytest.raises(InputError, match=words):
            visit(*given)
    with pytest.raises(InputError, match=r"leans by 11 degrees from the object's Z; allowed: 10"):
        evaluate_axis(SENSOR, KNOWN, leaning, AxisTest("Z", shortest_s=0.1))


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
    states = np.array([np.arange(8), [np.nan] * 8])
    columns = dict(zip(STATE_COLUMNS, states.T, strict=True))
    columns |= {"host_s": np.array([7.0, 7.5]), "misfit": np.array([0, 3])}
    bits, words = {"used": np.array([3, 7])}, {"used": np.array(["ab", "abc"])}
    write_table(tmp_path / "poses.csv", columns | words, {})
    for poses in (series_of_columns(columns | bits), read_series(tmp_path / "poses.csv")):
        assert poses.used.tolist() == [[True, True, False], [True, True, True]]
        assert poses.time.tolist() == [0, 0.5]
        assert poses.misfit.tolist() == [False, True]
        np.testing.assert_allclose(poses.states, states * STATE_UNITS)
    write_table(tmp_path / "late.csv", columns | {"host_s": np.array([7.0, 7.0])}, {})
    with pytest.raises(InputError, match="row 2: host_s is 7; the times of all rows must ascend"):
        read_series(tmp_path / "late.csv")


@pytest.mark.slow
def test_the_command_writes_the_errors_of_an_axis(tmp_path, run_in_process):
    """Of an axis with a backlash of 4 um, tested three times in each direction."""
    poses = series(np.tile([-1, 0.002, 1.002, 2.002, 3.002, 4, 2.998, 1.998, 0.998, -0.002], 3), 7)
    columns = dict(zip(STATE_COLUMNS, (poses.states / STATE_UNITS).T, strict=True))
    write_table(tmp_path / "poses.csv", columns | {"time_s": poses.time}, {})
    words = ("axis", "poses.csv", "--config", "paper", "--axis", "Z", "--dwell", "0.1",
             "--commands", "commands.csv", "-d")  # fmt: skip
    positions = np.tile(UP_AND_DOWN, 3)
    write_table(tmp_path / "commands.csv", {"position_mm": np.append(positions, 3)}, {})
    status, out, _ = run_in_process(*words, "more")
    assert (status, "Commanded positions without a dwell: 1, the first at" in out) == (1, True)
    assert not (tmp_path / "more/compensation.csv").exists()
    write_table(tmp_path / "commands.csv", {"position_mm": positions}, {})
    status, out, _ = run_in_process(*words, "out")
    assert (status, "EZZ: 24 dwells at 4 positions" in out) == (0, True)
    assert "runs at a position are 3 in the positive" in out
    reversal = re.search(r"reversal error +B +([\d.]+) ", out)
    assert float(reversal[1]) == pytest.approx(4, abs=0.3)
    head, *rows = (tmp_path / "out/compensation.csv").read_text().splitlines()
    assert head == "Z,EXZ,EYZ,EZZ,EAZ,EBZ,ECZ"
    assert np.loadtxt(rows, delimiter=",")[:, 0].tolist() == [0, 1, 2, 3]
    assert "actual less commanded" in (tmp_path / "out/run.yaml").read_text()


def test_stands_far_off_and_a_drift_there_and_back_are_named_and_left_out():
    commands = Commands(np.tile(UP_AND_DOWN, 5), np.tile(np.repeat([0, 1], 4), 5))
    clean = series(np.tile([-1, 0, 1, 2, 3, 4, 3, 2, 1, 0], 5), 8)  # -1 and 4 are no commands
    poses = replace(clean, states=clean.states.copy())
    poses.states[:, 2] += 3e-3 * np.sin(np.pi * poses.time / poses.time[-1])
    for stand, axis, size in ((12, 2, 0.015), (13, 2, 0.012), (27, 4, 1e-4)):
        poses.states[260 * stand : 260 * (stand + 1), axis] += size
    report, alone = (
        evaluate_axis(SENSOR, KNOWN, each, AxisTest("Z", commands, shortest_s=0.1))
        for each in (poses, clean)
    )
    assert np.abs(report.drifts) == pytest.approx(3e-3 * np.eye(6)[2], rel=0.2)
    notes = " ".join(report.notes())
    assert "at 1 mm (3.28 s), EZZ by +14.6 µm; at 2 mm (3.539 s), EZZ by +11.7 µm; at 2" in notes
    assert "(7.179 s), EBZ by +100 µrad" in notes
    assert "the axis or its encoder" in notes
    assert alone.undisturbed is None
    for n in (0, 1, 4, 7, 11):  # B, B_mean, R, E and A
        true, found = alone.quantities[2][n].value, report.undisturbed.quantities[2][n]
        assert found.value == pytest.approx(true, abs=1.5 * found.expanded)
        assert report.quantities[2][n].value > true + 10 * found.expanded
    errors = np.loadtxt(report.compensation().splitlines()[1:], delimiter=",")[:, 3]
    np.testing.assert_allclose(errors, 1e3 * alone.means[2], atol=0.1)


def test_the_poses_say_from_which_side_a_position_was_approached():
    """Equal commands in succession with an overrun between, which is no stand; runs from below
    whose return goes beyond their first position; and a recording that goes on beyond the last
    command, over the end and to its target again."""
    for way, turns, sides, strays in (
        ([-1, 0, 1, 1.5, 1, 2, 2.5, 2, 3], [0, 3, 6], [0, 0, 1, 0, 1, 0], 0),
        ([-1, 0, 1, 2, 3, -0.5, 0, 1, 2, 3], [0, 5], [0] * 8, 0),
        ([-1, 0, 1, 2, 3, 2, 1, 0, -1, 0, 1], [0, 4, 8], [0, 0, 0, 1, 1, 1], 2),
    ):
        way = np.array(way, float)
        found, counts = visit(series(way, 3, turns), np.delete(way, turns)[: len(sides)])
        assert (counts.stray_dwells, counts.missing) == (strays, ())
        assert found.direction.tolist() == sides
