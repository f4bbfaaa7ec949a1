"""Formulas that write machine code: the same bits as in floats, and what is rare when it is met."""

import ctypes
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from llvmlite import ir
from sensors import SENSORS, states

import facets
from facets.model import failures, geometry_of, jit, packed_vectors, packing, rare
from facets.optics import linearise
from facets.scalars import machine, tracing


def in_floats(sensor, state):
    """Readings and Jacobian of the text run with Python's floats."""
    detectors = linearise(geometry_of(sensor), tuple(state.tolist()))
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
    stale = packed_vectors(sensor).copy()
    stale[-1] = 0.0
    sensor.__dict__["_packed"] = stale
    np.testing.assert_array_equal(facets.readings(sensor, away), expected)
    assert packing.is_of_this_process(packed_vectors(sensor))


def wedges(count):
    """What the rare functions are asked: a point, and two unit vectors of any opening."""
    rng = np.random.default_rng(8)
    for distance in rng.uniform(0, 12, count):
        turns = rng.uniform(0, 2 * np.pi) + np.array([0, 0, rng.uniform(0.01, 3.1)])
        turns[0] = rng.uniform(0, 2 * np.pi)
        size = np.array([[distance], [1.0], [1.0]])
        yield (size * np.stack([np.cos(turns), np.sin(turns)], axis=1)).ravel()


@pytest.mark.parametrize("name", rare.NAMES)
def test_what_runs_as_text_at_first_has_the_bits_of_machine_code(name):
    """Else results would depend on how many were asked for before."""
    function, results = rare.FUNCTIONS[name]
    compiled = rare._compiled_function(name)
    for given in wedges(200):
        if name == "side_far":
            given[4] = given[0] * given[2] + given[1] * given[3]
        asked = (ctypes.c_double * 6)(*given)
        text, code = (ctypes.c_double * 8)(), (ctypes.c_double * 8)()
        assert rare._ran_as_text(function, (asked, text))
        compiled(asked, code)
        assert bytes(text) == bytes(code), given
        assert any(text[:results])


def test_what_the_text_refuses_is_left_to_machine_code(monkeypatch):
    def refuse(*_):
        raise OverflowError

    state = np.array([1.5, 0, 0, 0, 0, 0, 0, 0])
    expected = facets.readings(facets.Sensor(), state)
    number = rare.NAMES.index("quadrature_or_dark")
    monkeypatch.setitem(rare.FUNCTIONS, "quadrature_or_dark", (refuse, 8))
    monkeypatch.setattr(rare, "_COMPILED", {})
    monkeypatch.setattr(rare, "MAX_TEXT_S", 1e9)
    monkeypatch.setattr(rare, "_is_kept", lambda _: False)
    monkeypatch.setattr(rare, "_compiled_function", lambda _: rare.KIND(kept.address))
    kept = jit.callback(rare.__file__, rare.quadrature_or_dark, signature=jit.TWO_POINTERS)
    kept_address, rare.TABLE[number] = rare.TABLE[number], rare.address_of_first(number)
    try:
        np.testing.assert_array_equal(facets.readings(facets.Sensor(), state), expected)
    finally:
        rare.TABLE[number] = kept_address
    assert failures.FAILURES.raised == []


def test_what_goes_wrong_in_one_thread_is_not_raised_in_another():
    with ThreadPoolExecutor(1) as pool:
        pool.submit(lambda: failures.FAILURES.raised.append(ArithmeticError())).result()
        failures.raise_failure()
        with pytest.raises(ArithmeticError):
            pool.submit(failures.raise_failure).result()


def test_what_goes_wrong_in_a_rare_function_is_raised_after_the_kernel(monkeypatch):
    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(rare, "_COMPILED", {})
    monkeypatch.setattr(rare, "MAX_TEXT_S", 0.0)
    monkeypatch.setattr(jit, "callback", fail)
    number = rare.NAMES.index("quadrature_or_dark")
    kept, rare.TABLE[number] = rare.TABLE[number], rare.address_of_first(number)
    away = np.zeros(8)
    away[0] = 1.0
    try:
        with pytest.raises(KeyboardInterrupt):
            facets.readings(facets.Sensor(), away)
    finally:
        rare.TABLE[number] = kept
    assert failures.FAILURES.raised == []
    assert np.isfinite(facets.readings(facets.Sensor(), away)).all()


def test_a_formula_can_not_ask_what_only_its_code_will_know():
    function = ir.Function(ir.Module(), ir.FunctionType(machine.DOUBLE, [machine.DOUBLE]), "f")
    writer = machine.MachineWriter(ir.IRBuilder(function.append_basic_block()))
    with pytest.raises(TypeError, match="choose"):
        bool(tracing.Value(writer, function.args[0]) > 0)
