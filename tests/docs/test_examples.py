"""Every public name has a docstring that teaches, and the examples in them run."""

import doctest
import inspect

import pytest
from pages import DOCS

import facets

CALLABLES = [name for name in facets.__all__ if callable(getattr(facets, name))]


@pytest.mark.installed
@pytest.mark.parametrize("name", ["facets", *CALLABLES])
def test_examples_run(name):
    thing = facets if name == "facets" else getattr(facets, name)
    for example in doctest.DocTestFinder(recurse=False).find(thing, name, globs={}):
        assert doctest.DocTestRunner().run(example).failed == 0


@pytest.mark.installed
def test_every_public_name_says_what_it_is_and_every_function_has_an_example():
    for name in CALLABLES:
        assert len(inspect.getdoc(getattr(facets, name)).split()) >= 5, name
    functions = [getattr(facets, name) for name in CALLABLES]
    assert all(">>>" in part.__doc__ for part in functions if inspect.isfunction(part))


def test_the_examples_of_the_page_on_machine_code_run():
    results = doctest.testfile(str(DOCS / "fast-code.md"), module_relative=False)
    assert results.attempted > 15
    assert results.failed == 0
