"""What public functions take for numbers, and what they refuse, in one and the same way."""

import inspect
import re
from decimal import Decimal

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import facets
from facets.core import LABELS, as_floats

CONFIG = facets.load("paper")
SENSOR = CONFIG.sensor
REST = np.zeros(8)
READING = facets.readings(SENSOR, REST)
FREE = facets.Estimator("free", facets.Knowledge())

#: Every public function of an array of numbers, with what it takes.
OF_STATES = {
    "readings": lambda x: facets.readings(SENSOR, x),
    "jacobian": lambda x: facets.jacobian(SENSOR, x),
    "parameter_jacobian": lambda x: facets.parameter_jacobian(SENSOR, x),
    "reaches": lambda x: facets.reaches(SENSOR, x),
    "footprints": lambda x: facets.footprints(SENSOR, x),
    "margins": lambda x: facets.margins(SENSOR, x),
    "budgets": lambda x: facets.budgets(SENSOR, x, FREE),
    "uncertainties": lambda x: facets.uncertainties(SENSOR, x, FREE),
    "start": lambda x: facets.solve(SENSOR, READING, start=x).state,
}
OF_READINGS = {
    "solve": lambda x: facets.solve(SENSOR, x, beam="known").state,
    "Solver": lambda x: facets.Solver(SENSOR, beam="known").solve(x).state,
    "standard_deviations": lambda x: facets.standard_deviations(SENSOR, x),
    "add_noise": lambda x: facets.add_noise(SENSOR, x, np.random.default_rng(1)),
}
CASES = [
    *(pytest.param(function, REST, id=name) for name, function in OF_STATES.items()),
    *(pytest.param(function, READING, id=name) for name, function in OF_READINGS.items()),
]


@pytest.mark.parametrize(("function", "sound"), CASES)
def test_what_is_missing_is_no_number(function, sound):
    """A masked number, None, and what pandas calls missing give what NaN gives."""
    values = sound.tolist()
    expected = function([np.nan, *values[1:]])
    masked = np.ma.array(sound, mask=[True] + [False] * (len(sound) - 1))
    table = pd.DataFrame([[pd.NA, *values[1:]]], dtype="Float64")
    for missing in (
        masked,
        masked.astype(object),
        list(masked),
        [None, *values[1:]],
        np.array([pd.NA, *values[1:]]),
        table.loc[0],
    ):
        np.testing.assert_array_equal(function(missing), expected)
    if function not in (OF_READINGS["Solver"], OF_STATES["start"]):
        np.testing.assert_array_equal(function(table), [expected])
        np.testing.assert_array_equal(function([masked, sound])[0], expected)


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        (None, "is None"),
        (CONFIG, "is a Config"),
        (["1"] * 8, "has text in it: '1'"),
        ([1j] * 8, "has complex numbers in it: 1j"),
        (np.ma.array(np.zeros(8, complex), mask=True), "has complex numbers in it"),
        ([True] * 8, "has truth values in it"),
        ([[0.0] * 8, [0.0]], "has rows of different lengths"),
        (iter([0.0] * 8), "has the list_iterator"),
        ([10**400] * 8, "has a number in it that is too large"),
        (np.zeros(5), "has shape (5,)"),
    ],
    ids=lambda value: str(value)[:25] if isinstance(value, str) else type(value).__name__,
)
def test_what_is_no_array_of_numbers_is_refused(given, fault):
    for name, function in (OF_STATES | OF_READINGS).items():
        with pytest.raises(facets.InputError, match=re.escape(fault)) as refused:
            function(given)
        assert re.search("needed: |allowed: ", str(refused.value)), name


@pytest.mark.parametrize(
    ("part", "numbers"),
    [
        (facets.Psd, {"radius": np.int64(-1)}),
        (facets.Beam, {"power": np.float32(0)}),
        (facets.Beam, {"power": np.float32("nan")}),
        (facets.Electronics, {"adc_bits": 33}),
    ],
    ids=str,
)
def test_bounds_of_a_sensor_hold_for_numbers_of_numpy_too(part, numbers):
    with pytest.raises(facets.InputError, match=f"^{next(iter(numbers))}"):
        part(**numbers)


@pytest.mark.parametrize(("function", "sound"), CASES)
def test_names_count_where_there_are_names(function, sound):
    """Columns in any order, with others beside them, and in their units; then rows of them."""
    names, units = LABELS[len(sound)]
    state = np.array([0.01, 0.02, 0.3, 1e-3, -2e-3, 3e-3, 0.0, 0.0])
    sound = state if len(sound) == 8 else facets.readings(SENSOR, state)
    table = pd.DataFrame([sound / units], columns=list(names)).iloc[:, ::-1].assign(time_s=1.0)
    bare = pd.Series(sound, index=[name.rpartition("_")[0] for name in names])[::-1]
    expected = function(sound)
    for row in (table.iloc[0], table.to_records(index=False)[0], bare):
        np.testing.assert_allclose(function(row), expected, rtol=1e-9, atol=1e-12)
    if function not in (OF_READINGS["Solver"], OF_STATES["start"]):
        for rows in (table, pa.Table.from_pandas(table), [table.iloc[0]]):
            np.testing.assert_allclose(function(rows), [expected], rtol=1e-9, atol=1e-12)
    for lacking in (table.drop(columns=names[1]), pd.concat([table, table[[names[1]]]], axis=1)):
        with pytest.raises(facets.InputError, match=f"{names[1]}; needed: the columns {names[0]}"):
            function(lacking)


def test_names_of_poses_and_places_count():
    table = pd.DataFrame([[4.0, 3.0, 0.2, 0.1]], columns=["yaw_mrad", "tx_mm", "by_mm", "bx_mm"])
    table[["ty_mm", "tz_mm", "roll_mrad", "pitch_mrad"]] = 0.0
    expected = [3.0, 0, 0, 0, 0, 4e-3]
    np.testing.assert_allclose(facets.transform(table).pose, [expected], atol=1e-15)
    from_zero = facets.transform(table, zero=table.iloc[0]).pose
    np.testing.assert_allclose(from_zero, np.zeros((1, 6)), atol=1e-15)
    np.testing.assert_array_equal(facets.Prior(table[["by_mm", "bx_mm"]], 0.1).mean, [[0.1, 0.2]])


def test_numbers_of_other_types_are_numbers():
    for eight in ([Decimal(0)] * 8, np.zeros(8, np.float32), np.zeros(8, ">f8"), range(8), [0] * 8):
        assert as_floats(eight, "state").dtype == np.float64
    assert as_floats([], "state").shape == (0,)
    assert as_floats(np.empty((0, 8), object), "state").shape == (0, 8)
    assert as_floats(REST, "state") is REST


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: facets.readings(CONFIG, REST), "sensor is a Config; .*; pass config.sensor"),
        (lambda: facets.simulate(SENSOR), "config is a Sensor; allowed: a Config"),
        (lambda: facets.simulate(CONFIG, "yaw-sweep"), "motions is .* a sequence, each text"),
        (lambda: facets.axis_ranges(SENSOR, CONFIG, [0] * 6), "rules is .*pass config.range"),
        (lambda: facets.trace(SENSOR, CONFIG.range, ("tz", "up")), "two different names of tx"),
        (lambda: facets.uncertainties(SENSOR, REST, ("", 0.0)), "an Estimator or a Know"),
        (lambda: facets.solve(SENSOR, READING, threads=-1), "threads is -1"),
        (lambda: facets.readings(SENSOR, REST, "exakt"), 'irradiance is \'exakt\'.*"exact"'),
        (lambda: facets.margins(SENSOR, REST, whole="no"), "whole is .* allowed: True or False"),
        (lambda: facets.solve(SENSOR, READING, beam=[0, 0]), 'beam is .*"known" or a Prior'),
        (lambda: facets.budgets(SENSOR, REST, facets.Estimator("", "known")),
         "knowledge is 'known'; allowed: a facets.Knowledge"),
        (lambda: facets.Prior((0, 0), np.nan), "sigma is nan; allowed: 0 or more"),
        (lambda: facets.add_noise(SENSOR, READING, 1), r"rng is the int 1; .*default_rng\(1\)"),
        (lambda: facets.Beam(power="0.3"), "power is the str '0.3'; allowed: a number"),
        (lambda: facets.Sensor(psds=facets.Psd()), "psds is a Psd; .*sequence of 3, each a Psd"),
        (lambda: facets.Rules(coarsest=(1.0,)), "coarsest has 1 numbers; allowed: 6"),
        (lambda: facets.zero_pose(SENSOR, REST, temperature=293.15), "allowed: -60 to 150 degC"),
    ],
)  # fmt: skip
def test_an_argument_of_another_kind_is_refused(call, message):
    with pytest.raises(facets.InputError, match=message):
        call()


def test_every_public_function_checks_its_arguments():
    """And every class that a user makes objects of; the others are results, and lists of words."""
    results = {"AxisRange", "Boundary", "Config", "ObjectPose", "Optimum", "Poses", "Segment",
               "Solution", "ZeroPose"}  # fmt: skip
    other = {"Estimator", "Status"}  # a NamedTuple, which who takes it looks at, and an Enum
    for name in set(facets.__all__) - results - other:
        thing = getattr(facets, name)
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            thing = thing.__init__
        if inspect.isfunction(thing):
            assert hasattr(thing, "__wrapped__"), name


def test_what_was_allowed_before_is_not_allowed_of_another_type():
    for _ in range(3):
        assert facets.solve(SENSOR, READING, beam="known", threads=1).ok
    for wrong in (1.0, True):
        with pytest.raises(facets.InputError, match="threads"):
            facets.solve(SENSOR, READING, beam="known", threads=wrong)
