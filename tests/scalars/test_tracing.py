"""What writers of code share: what they leave out gives the bits of floats; branches stay apart."""

import ctypes
import math
import struct

import pytest
from llvmlite import binding, ir

from facets.firmware.c_numbers import CWriter
from facets.scalars import dual, lanes, tracing
from facets.scalars import machine as machine_

pytestmark = pytest.mark.installed


def engine_of(module: ir.Module):
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine()
    parsed = binding.parse_assembly(str(module))
    parsed.verify()
    engine = binding.create_mcjit_compiler(parsed, machine)
    engine.finalize_object()
    return engine


def code_of(formula, count: int):
    """A formula of a writer and two numbers as machine code: a function of two floats."""
    module = ir.Module()
    kind = ir.FunctionType(ir.VoidType(), [machine_.DOUBLE.as_pointer()] * 2)
    function = ir.Function(module, kind, "formula")
    writer = machine_.MachineWriter(ir.IRBuilder(function.append_basic_block()))
    numbers = [writer.load(function.args[0], n) for n in range(2)]
    for n, result in enumerate(formula(writer, *numbers)):
        writer.store(result, function.args[1], n)
    writer.builder.ret_void()
    engine = engine_of(module)
    start = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(
        engine.get_function_address("formula")
    )

    def call(*arguments: float) -> list[float]:
        given, found = (ctypes.c_double * 2)(*arguments), (ctypes.c_double * count)()
        start(ctypes.addressof(given), ctypes.addressof(found))
        return list(found)

    call.keeps = engine
    return call


def bits(number: float) -> bytes:
    return b"nan" if math.isnan(number) else struct.pack("<d", number)


def odd_numbers(x, y):
    less = -x
    return (
        x * 1, 1 * x, x * -1, -1 * x, x / 1, x / 8, x / -0.25, y - less, x + -y, less + y, less - y,
        less * y, less * -y, -less, less / y, x * 0, x * 0.0, x * -0.0, x + 0, 0 + x, 0 - x, x - 0,
        x - x, y * x - x * y, 3 * x, x * y + y * x, y + x - (x + y), abs(less),
    )  # fmt: skip


def test_one_pose_has_the_bits_of_floats_for_any_number():
    """Zeros have signs, and what is not finite stays so."""
    count = len(odd_numbers(1.0, 2.0))
    call = code_of(lambda _, x, y: odd_numbers(x, y), count)
    values = (0.0, -0.0, 1.5, -7.3, 1e-310, 1e300, math.inf, -math.inf, math.nan)
    for x in values:
        for y in [each for each in values if each != 0]:
            expected = [bits(number) for number in odd_numbers(x, y)]
            assert [bits(number) for number in call(x, y)] == expected, (x, y)


def test_what_one_branch_computes_is_computed_anew_in_the_other_and_after():
    def formula(writer, x, y):
        product = writer.choose(
            x > 0,
            lambda: writer.choose(y > 0, lambda: x * y + 1, lambda: x * y + x / y),
            lambda: -(x * y),
        )
        return product, x * y, -(x * y)

    call = code_of(formula, 3)  # LLVM refuses a number that is not computed on every way
    assert call(2.0, 3.0) == [7, 6, -6]
    assert call(2.0, -4.0) == [-8.5, -8, 8]
    assert call(-2.0, 3.0) == [6, -6, 6]


def test_what_is_computed_before_a_branch_is_not_computed_again():
    module = ir.Module()
    function = ir.Function(
        module, ir.FunctionType(machine_.DOUBLE, [machine_.DOUBLE.as_pointer()]), "formula"
    )
    writer = machine_.MachineWriter(ir.IRBuilder(function.append_basic_block()))
    x, y = (writer.load(function.args[0], n) for n in range(2))
    before = x * y
    found = writer.choose((x > 0) & (x > 0), lambda: y * x + 1, lambda: y * x - 1)
    writer.builder.ret((found + before).ir)
    assert str(module).count("fmul") == 1
    assert str(module).count("fcmp") == 1


def test_c_computes_nothing_twice_on_a_way_and_all_of_it_on_each():
    writer = CWriter()
    x, y = writer.variable("x"), writer.variable("y")
    once = x + y
    (found,) = writer.choose(
        x > y, lambda: (x * y + (y + x) + y * x,), lambda: ((0 - (0 - x)) * y - once * 0,)
    )
    writer.put("found[0]", found - y * x)
    text = "\n".join(writer.statements)
    assert text.count("x + y") == 1
    assert text.count("y + x") == 0
    assert text.count("x * y") == 2
    assert text.count("y * x") == 1


def lane_writer() -> lanes.LaneWriter:
    function = ir.Function(ir.Module(), ir.FunctionType(ir.VoidType(), []), "formula")
    return lanes.LaneWriter(ir.IRBuilder(function.append_basic_block()), 4)


def c_writer() -> CWriter:
    return CWriter()


@pytest.mark.parametrize("make", [lane_writer, c_writer])
def test_zeros_are_left_out_where_a_writer_says_so(make):
    writer = make()
    x = (
        writer.variable("x")
        if make is c_writer
        else writer.spread(ir.Constant(machine_.DOUBLE, 2.0))
    )
    assert x * 0 == 0.0
    assert x - x == 0.0
    assert 0 / x == 0.0
    assert (x + 0) is x
    less = 0 - x
    assert less.opposite is x
    assert -less is x
    slope = (dual.Dual(x, 0.0) * x + dual.Dual(x, 0.0) / x).imag
    assert slope == 0.0
    assert tracing.maximum(dual.Dual(x, 0.0), dual.Dual(x * x, 0.0)).imag == 0.0


def test_lanes_divide_once_by_a_divisor_and_by_plain_numbers_not_at_all():
    writer = lane_writer()
    x, y = (writer.spread(ir.Constant(machine_.DOUBLE, value)) for value in (2.0, 3.0))
    total = x / y + x * x / y + 1 / y + x / 3 + x / 4
    assert total is not None
    assert str(writer.builder.module).count("fdiv") == 1


def test_elementary_functions_of_plain_numbers_are_known_at_once():
    assert lane_writer().function("sqrt", 2.0) == math.sqrt(2.0)
    assert c_writer().function("atan2", 1.0, 2.0) == math.atan2(1.0, 2.0)
