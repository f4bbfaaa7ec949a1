"""What is rare when machine code meets it: the functions that it calls, and their failures."""

import numpy as np
import pytest

import facets
from facets.model import jit, rare

NUMBER = rare.NAMES.index("quadrature_or_dark")
#: Faint facets, for which machine code calls that function.
AWAY = np.array([1.5, 0, 0, 0, 0, 0, 0, 0])


@pytest.fixture
def first_call(monkeypatch):
    """The table as it is before any of its functions has been compiled."""
    monkeypatch.setattr(rare, "_COMPILED", {})
    kept = rare.TABLE[NUMBER]
    rare.TABLE[NUMBER] = rare.address_of_first(NUMBER)
    yield monkeypatch
    rare.TABLE[NUMBER] = kept


def test_what_the_text_refuses_is_left_to_machine_code(first_call):
    def refuse(*_):
        raise OverflowError

    expected = facets.readings(facets.Sensor(), AWAY)
    compiled = jit.callback(rare.__file__, rare.quadrature_or_dark, signature=jit.TWO_POINTERS)
    first_call.setitem(rare.FUNCTIONS, "quadrature_or_dark", (refuse, 8))
    first_call.setattr(rare, "MAX_TEXT_S", 1e9)
    first_call.setattr(rare, "_is_kept", lambda _: False)
    first_call.setattr(rare, "_compiled_function", lambda _: rare.KIND(compiled.address))
    np.testing.assert_array_equal(facets.readings(facets.Sensor(), AWAY), expected)


def test_what_goes_wrong_in_a_rare_function_is_raised_once_after_the_kernel(first_call):
    def fail(*_, **__):
        raise KeyboardInterrupt

    first_call.setattr(rare, "MAX_TEXT_S", 0.0)
    first_call.setattr(jit, "callback", fail)
    with pytest.raises(KeyboardInterrupt):
        facets.readings(facets.Sensor(), AWAY)
    first_call.undo()
    assert np.isfinite(facets.readings(facets.Sensor(), AWAY)).all()
