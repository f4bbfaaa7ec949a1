"""Formulas that write machine code: the same bits as in floats, and what is rare when it is met."""

import numpy as np
import pytest
from llvmlite import ir
from sensors import SENSORS, states

import facets
from facets.model import jit, kernels, rare
from facets.model.arrays import geometry_of, packed
from facets.optics.gradient import linearised
from facets.scalars.machine import DOUBLE, Value, Writer


def in_floats(sensor, state):
    """Readings and Jacobian of the text run with Python's floats."""
    detectors = linearised(geometry_of(sensor), tuple(state.tolist()))
    values = np.array([values for values, _ in detectors]).ravel()
    return values, np.array([rows for _, rows in detectors]).reshape(9, 8)


@pytest.mark.parametrize("name", ["paper", "skewed0", "skewed4"])
@pytest.mark.parametrize("offset", [0.2, 2.0], ids=["bright", "faint and far"])
def test_machine_code_has_the_digits_of_the_text(name, offset):
    """An apex 2 mm off the beam is 9 sigmas away, where the rare functions are called."""
    sensor = SENSORS[name]
    for state in states(20, seed=5, offset=offset):
        values, slopes = in_floats(sensor, state)
        np.testing.assert_allclose(facets.readings(sensor, state), values, rtol=1e-11, atol=1e-13)
        found = facets.jacobian(sensor, state)
        dark = np.isnan(slopes).any(axis=1)
        scale = np.abs(slopes[~dark]).max(axis=0)
        assert (np.abs(found[~dark] - slopes[~dark]) <= 1e-9 * scale).all()


def test_a_copy_of_a_sensor_from_another_process_is_packed_again():
    sensor = facets.Sensor()
    away = np.zeros(8)
    away[0] = 1.5
    expected = facets.readings(sensor, away)
    stale = packed(sensor).copy()
    stale[-1] = 0.0
    sensor.__dict__["_packed"] = stale
    np.testing.assert_array_equal(facets.readings(sensor, away), expected)
    assert kernels.is_of_this_process(packed(sensor))


def test_what_goes_wrong_in_a_rare_function_is_raised_after_the_kernel(monkeypatch):
    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(rare, "_COMPILED", {})
    monkeypatch.setattr(jit, "callback", fail)
    number = rare.NAMES.index("faint_or_dark")
    kept, rare.TABLE[number] = rare.TABLE[number], rare.address_of_first(number)
    away = np.zeros(8)
    away[0] = 1.0
    try:
        with pytest.raises(KeyboardInterrupt):
            facets.readings(facets.Sensor(), away)
    finally:
        rare.TABLE[number] = kept
    assert jit.FAILURES == []
    assert np.isfinite(facets.readings(facets.Sensor(), away)).all()


def test_a_formula_can_not_ask_what_only_its_code_will_know():
    function = ir.Function(ir.Module(), ir.FunctionType(DOUBLE, [DOUBLE]), "f")
    writer = Writer(ir.IRBuilder(function.append_basic_block()))
    with pytest.raises(TypeError, match="choose"):
        bool(Value(writer, function.args[0]) > 0)
