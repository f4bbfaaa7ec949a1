"""What writers make of a formula: the bits of floats, and no zeros in lanes."""

import ctypes
import math
from fractions import Fraction

import numpy as np
import pytest
from llvmlite import binding, ir

from facets.model import compile_objects, load_objects
from facets.optics import sum_of_products
from facets.scalars import dispatch, dual, lane_rows, lanes

pytestmark = pytest.mark.installed


def odd_numbers(x, y):
    less = -x
    return (
        x * 1, 1 * x, x * -1, -1 * x, x / 1, x / 8, x / -0.25, y - less, x + -y, less + y, less - y,
        less * y, less * -y, -less, less / y, x * 0, x * 0.0, x * -0.0, x + 0, 0 + x, 0 - x, x - 0,
        x - x, y * x - x * y, 3 * x, x * y + y * x, y + x - (x + y), abs(less), x - -y, y / 1,
    )  # fmt: skip


def new_function(make):
    """A writer of a function of two pointers to numbers, and these."""
    kind = ir.FunctionType(ir.VoidType(), [lanes.DOUBLE.as_pointer()] * 2)
    function = ir.Function(ir.Module(), kind, "formula")
    return make(ir.IRBuilder(function.append_basic_block())), *function.args


def compiled(writer):
    writer.builder.ret_void()
    module = writer.builder.module
    module.triple = binding.get_process_triple()
    engine = load_objects(compile_objects("formula", module))
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2)(engine.get_function_address("formula"))

    def run(given, count):
        asked, results = np.array(given, float), np.empty(count)
        call(asked.ctypes.data, results.ctypes.data)
        return results.tolist()

    run.keeps = engine
    return run


def lane_writer(builder):
    return lanes.LaneWriter(builder, 4)


def test_each_lane_computes_as_floats_do():
    writer, asked, results = new_function(lane_writer)
    x, y = lane_rows.load_rows(writer, asked, 2, 2)
    angle, sine = writer.function("atan2", y, x), writer.function("sin", x / 8)
    lane_rows.store_rows(
        writer,
        [angle, sine, *(n + 0 * x for n in odd_numbers(x, y))],
        results,
        2 + len(odd_numbers(1, 1)),
    )
    run = compiled(writer)
    turns = np.arange(0.05, 6.28, 0.4).reshape(4, 4)
    for rows in np.stack([2 * np.cos(turns), 2 * np.sin(turns)], axis=-1):
        expected = [
            [math.atan2(y, x), math.sin(x / 8), *odd_numbers(x, y)] for x, y in rows.tolist()
        ]
        np.testing.assert_allclose(
            run(rows, np.size(expected)), np.ravel(expected), rtol=7e-16, atol=1e-300
        )


def test_sums_of_products_keep_twice_the_digits():
    """In lanes, too, where a product that is fused into a sum would be no rounded number."""
    writer, asked, results = new_function(lane_writer)
    lane_rows.store_rows(
        writer, sum_of_products(*lane_rows.load_rows(writer, asked, 4, 4)), results, 2
    )
    run = compiled(writer)
    for rows in np.random.default_rng(1).uniform(-40, 40, (25, 4, 4)):
        for found, (a, b, c, d) in zip(np.reshape(run(rows, 8), (4, 2)), rows, strict=True):
            exact = Fraction(a) * Fraction(b) + Fraction(c) * Fraction(d)
            assert abs(sum(map(Fraction, found)) - exact) <= 2**-90 * abs(exact)


def swapped_sum(x, y):
    return x * y + y, dispatch.sum_over(weighted, ((1.0, 2.0), (3.0, 4.0)), x)[0]


def weighted(node, weight, x):
    return (node * weight * x,)


def test_what_few_lanes_need_is_called_for_them_and_computed_anew_after():
    writer, asked, results = new_function(lane_writer)
    x, y = lane_rows.load_rows(writer, asked, 2, 2)
    first, second = dispatch.where_any(x > 0, (x, y), swapped_sum, y, x)
    lane_rows.store_rows(writer, [first, second, x * y], results, 3)
    run = compiled(writer)  # LLVM refuses a number that is not computed on every way
    rows = [[2, 3], [-1, 5], [4, -2], [0, 1]]
    assert run(rows, 12) == [8, 42, 6, -1, 5, -5, -4, -28, -8, 0, 1, 0]
    assert run([[-1, 2]] * 4, 12) == [-1, 2, -2] * 4


def test_lanes_leave_out_zeros():
    writer, asked, _ = new_function(lane_writer)
    (x,) = lane_rows.load_rows(writer, asked, 1, 1)
    assert x * 0 == x - x == 0 / x == 0.0
    assert (x + 0) is x
    assert -(0 - x) is x
    assert (dual.Dual(x, 0.0) * x + dual.Dual(x, 0.0) / x).imag == 0.0


def test_a_formula_can_not_ask_what_only_its_code_will_know():
    writer, asked, _ = new_function(lane_writer)
    with pytest.raises(TypeError, match="select"):
        bool(writer.load(asked, 0) > 0)
