"""What the translator makes of the kinds of statements that the package's texts have."""

from __future__ import annotations

import json
import shutil
import subprocess
from math import hypot
from typing import Any, NamedTuple

import pytest

from facets.pictures.page.javascript import javascript, literal, name_of
from facets.pictures.page.model import text_of
from facets.scalars import dispatch

needs_node = pytest.mark.skipif(not shutil.which("node"), reason="needs Node")


class Pair(NamedTuple):
    one: Any
    two: Any = 3.0


class Holder(NamedTuple):
    function: Any


def texts_of(numbers, holder: Holder):
    """Slices, lists, keys, fields that are functions, and replaced fields."""
    over = [Pair(number) for number in numbers[1:3]]
    over += [Pair(number)._replace(one=number, two=2 * number) for number in numbers[:2]]
    over.append(Pair(max(numbers[k] for k in range(3)), hypot(numbers[0], numbers[1])))
    keys = {"sum": over[2].one + holder.function(numbers[0]), "last": over[4].two}
    return keys["sum"], keys["last"], [(one, two) for one, two in over], len(over), None is keys


def slope_of(x):
    """A number that carries its derivative, made on the way."""
    over = complex(x, 1e-30)
    return (dispatch.sqrt(over * over + 1) / dispatch.sin(over)).imag / 1e-30


def run(script):
    done = subprocess.run(["node", "-e", script], check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


@needs_node
def test_a_text_gives_what_python_gives():
    numbers = (3.0, 4.0, 0.5)
    holder = Holder(lambda x: x * x)
    script = f"""{text_of("numbers.js")}
    {javascript(texts_of)}
    const holder = {{function: (x) => x * x}};
    console.log(JSON.stringify({name_of(texts_of)}({literal(numbers)}, holder)));"""
    total, last, over, count, nothing = texts_of(numbers, holder)
    wanted = [total, last, [list(pair) for pair in over], count, nothing]
    assert run(script) == wanted


@needs_node
def test_a_derivative_is_carried_along():
    script = f"""{text_of("numbers.js")}{text_of("dual.js")}
    {javascript(slope_of)}
    console.log({name_of(slope_of)}(0.7));"""
    step = 1e-6
    ahead, behind = (hypot(x, 1) / dispatch.sin(x) for x in (0.7 + step, 0.7 - step))
    wanted = (ahead - behind) / (2 * step)
    assert run(script) == pytest.approx(wanted, rel=1e-8)


def unpacked_fields(thing: Holder):
    return thing.missing(1.0)


def test_a_call_of_what_is_no_field_is_refused():
    with pytest.raises(TypeError, match=r"thing\.missing"):
        javascript(unpacked_fields)
