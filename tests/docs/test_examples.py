"""Every public name has a docstring that teaches, and the examples in them run."""

import doctest
import inspect

import pytest

import facets

pytestmark = pytest.mark.installed


def callables() -> list[str]:
    return [name for name in facets.__all__ if callable(getattr(facets, name))]


@pytest.mark.parametrize("name", callables())
def test_a_public_name_says_what_it_is(name):
    text = inspect.getdoc(getattr(facets, name)) or ""
    assert len(text.split()) >= 5, f"facets.{name} has no docstring"


@pytest.mark.parametrize("name", ["facets", *callables()])
def test_examples_run(name):
    thing = facets if name == "facets" else getattr(facets, name)
    for example in doctest.DocTestFinder(recurse=False).find(thing, name, globs={}):
        assert doctest.DocTestRunner().run(example).failed == 0


def test_every_public_function_has_an_example():
    without = [
        name
        for name in callables()
        if inspect.isfunction(getattr(facets, name)) and ">>>" not in getattr(facets, name).__doc__
    ]
    assert without == []
