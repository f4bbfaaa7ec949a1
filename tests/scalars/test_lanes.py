"""Numbers of several poses at once: each lane as floats have it, and those that leave."""

import ctypes
import math

import numpy as np
import pytest
from llvmlite import binding, ir

from facets.estimation import straight
from facets.optics import side, side_central
from facets.scalars import lanes as lanes_
from facets.scalars import machine as machine_

pytestmark = pytest.mark.installed


def run(formula, *rows: list[float]) -> tuple[np.ndarray, list[int]]:
    """What a formula of a writer and numbers gives in each lane, and which lanes it leaves.

    rows: for each number, its values in the lanes.
    """
    lanes = len(rows[0])
    module = ir.Module()
    pointer = ir.PointerType(machine_.DOUBLE)
    function = ir.Function(module, ir.FunctionType(machine_.LONG, [pointer, pointer]), "formula")
    code = lanes_.LaneWriter(ir.IRBuilder(function.append_basic_block()), lanes)
    numbers = code.load_rows(function.args[0], len(rows), len(rows))
    results = formula(code, *numbers)
    code.store_rows(list(results), function.args[1], len(results))
    code.builder.ret(code.bits(code.left))
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine()
    engine = binding.create_mcjit_compiler(binding.parse_assembly(str(module)), machine)
    engine.finalize_object()
    call = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)(
        engine.get_function_address("formula")
    )
    given = np.ascontiguousarray(np.array(rows, float).T)
    found = np.empty((lanes, len(results)))
    bits = call(given.ctypes.data, found.ctypes.data)
    return found, [lane for lane in range(lanes) if bits >> lane & 1]


def test_each_lane_computes_as_floats_do():
    a, b = [1.5, -2.0, 0.25, 3.0], [0.5, 4.0, -8.0, 7.0]
    found, left = run(
        lambda code, x, y: (x + y, x - y, x * y, abs(x), -(0 - x), code.function("sqrt", x * x)),
        a,
        b,
    )
    x, y = np.array(a), np.array(b)
    expected = np.column_stack([x + y, x - y, x * y, abs(x), x, abs(x)])
    np.testing.assert_array_equal(found, expected)
    assert left == []


@pytest.mark.parametrize("lanes", [2, 4, 8])
@pytest.mark.parametrize("width", [1, 3, 9, 15])
def test_rows_are_read_and_written_as_they_stand(lanes, width):
    """By squares, transposed, and narrower ones where these end."""
    rows = np.random.default_rng(width).normal(size=(width, lanes))
    found, left = run(lambda code, *numbers: numbers, *rows.tolist())
    np.testing.assert_array_equal(found, rows.T)
    found, _ = run(lambda code, *numbers: numbers[::-1], *rows.tolist())
    np.testing.assert_array_equal(found, rows[::-1].T)
    assert left == []


@pytest.mark.parametrize("lanes", [2, 4, 8])
def test_a_loop_goes_on_while_a_lane_does(lanes):
    """Halvings of a number until it is below one; lanes that began there are left."""

    def formula(code, x):
        numbers, going = lanes_.LaneMemory(code, 2), lanes_.LaneFlag(code, x > 0)
        numbers[0], numbers[1] = x, 0.0
        with code.do_while() as repetition:
            code.leave(numbers[0] < 0)
            on = going.get() & (numbers[0] > 1)
            numbers[1] = numbers[1] + code.select(on, 1.0, 0.0)
            numbers[0] = code.select(on, numbers[0] / 2, numbers[0])
            going.set(on)
            repetition.again = code.any(on)
        return numbers[0], numbers[1]

    given = [5.0, -3.0, 0.5, 1e6, 2.0, 3.0, 0.0, 9.0][:lanes]
    found, left = run(formula, given)
    expected = [max(math.ceil(math.log2(x)), 0) if x > 0 else 0 for x in given]
    np.testing.assert_array_equal(found[:, 1], expected)
    np.testing.assert_array_equal(found[:, 0], given / 2.0 ** np.array(expected))
    assert left == [1]


def test_negatives_zeros_and_ones_are_taken_out_of_sums_and_products():
    a, b = [1.5, -2.0, 0.25, 3.0], [0.5, 4.0, -8.0, 7.0]

    def formula(code, x, y):
        return x + -y, x - -y, -x * y, -x + y, 0 * x + y, x - 0, 1 * y, x - x, y / 1, 0 - y, x / y

    x, y = np.array(a), np.array(b)
    expected = [x - y, x + y, -x * y, y - x, y, x, y, 0 * x, y, -y, x / y]
    found, _ = run(formula, a, b)
    np.testing.assert_allclose(found, np.column_stack(expected), rtol=3e-16)


def test_the_arc_tangent_knows_every_quarter():
    for start in np.arange(0.05, 6.2, 0.4):
        angles = start + np.array([0, 0.1, 0.2, 0.3])
        found, left = run(
            lambda code, y, x: (code.function("atan2", y, x),),
            (2 * np.sin(angles)).tolist(), (2 * np.cos(angles)).tolist(),
        )  # fmt: skip
        exact = [math.atan2(math.sin(angle), math.cos(angle)) for angle in angles]
        np.testing.assert_allclose(found[:, 0], exact, rtol=6e-16)
        assert left == []


@pytest.mark.parametrize("name", ["sin", "cos"])
def test_large_angles_leave(name):
    angles = [0.3, -1.2, 0.99, math.nan]
    found, left = run(lambda code, x: (code.function(name, x),), angles)
    assert left == [1, 3]
    assert found[2, 0] == pytest.approx(getattr(math, name)(0.99), rel=1e-15)


def test_a_side_far_off_the_beam_leaves():
    x = [1.0, 2.01, -1.99, math.nan]
    found, left = run(lambda code, x, u: side((x, u * 0.0 + 0.0), (u, x * 0)), x, [1.0] * 4)
    assert left == [1, 3]
    np.testing.assert_allclose(found[0], side_central((1.0, 0.0), 1.0, 0.0), atol=1e-16)


def test_what_is_rare_leaves_where_its_way_is_taken_alone():
    def formula(code, x):
        chosen = code.choose(
            x > 0,
            lambda: code.choose(x > 2, lambda: code.rarely(abs, x, x), lambda: 2 * x),
            lambda: -x,
        )
        return (chosen,)

    found, left = run(formula, [1.0, 3.0, -4.0, math.nan])
    assert left == [1]
    assert found[[0, 2], 0].tolist() == [2.0, 4.0]
    assert lanes_.UNFILLED is not None


def test_normal_equations_without_digits_leave():
    def formula(code, a, b):
        factor, fine = straight.cholesky(code, [[a], [b, a]])
        code.leave(~fine)
        return straight.solution(factor, [a, b])[0]

    found, left = run(formula, [1.0, 1.0, 4.0, 1.0], [0.5, 1.0 - 1e-10, -1.0, 2.0])
    assert left == [1, 3]
    np.testing.assert_allclose(found[[0, 2]], [[1, 0], [1, 0]], atol=1e-15)
