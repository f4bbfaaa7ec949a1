"""Formulas on a tape: values, gradients and Hessians are casadi's own, operation by operation."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from sensors import SENSORS, states

import facets
from facets.design.footprint import edge_clearances
from facets.design.tape import tape_of
from facets.model.arrays import parameters
from facets.optics.forward import build_geometry

pytestmark = pytest.mark.installed

X, S = ca.SX.sym("x", 3), ca.SX.sym("s", 2)
a, b, c = (X[i] for i in range(3))
s, t = (S[i] for i in range(2))
FORMULAS = {
    "sum": a + b - c + s - 2,
    "products": a * b * c + a * s + s * t + c * c,
    "quotients": a / b + s / c + c / t + 1 / a + t / s,
    "exponentials": ca.exp(a * s) + ca.log(b + t) + ca.exp(s),
    "circles": ca.sin(a * b) + ca.cos(c + s) + ca.sin(t),
    "roots": ca.sqrt(a + b * b) + ca.sqrt(s),
    "errors": ca.erf(a * t) * ca.erf(s),
    "angles": ca.atan2(a, b) + ca.atan2(s, c) + ca.atan2(b, t) + ca.atan2(s, t),
    "signs": -a + 2 * b - (-s),
    "choices": ca.if_else(a < s, a * b, b * c) + ca.if_else(t <= s, c, a * a),
    "constant": ca.SX(3.0),
    "a state alone": s * t,
}


@pytest.mark.parametrize("name", list(FORMULAS))
def test_an_operation_has_its_derivatives(name):
    formula = FORMULAS[name]
    hessian, gradient = ca.hessian(formula, X)
    exact = ca.Function("exact", [X, S], [formula, gradient, hessian])
    tape = tape_of(X, S, formula)
    rng = np.random.default_rng(1)
    given = rng.uniform(0.2, 2.0, (7, 2))  # seven: the last of four side by side is alone
    for x in rng.uniform(0.2, 2.0, (3, 3)):
        found = tape(x, given, 2)
        assert found.shape == (7, 1, 10)
        for row, state in zip(found[:, 0], given, strict=True):
            value, slope, bend = (np.array(part) for part in exact(x, state))
            np.testing.assert_allclose(row[0], value.ravel()[0], rtol=1e-13)
            np.testing.assert_allclose(row[1:4], slope.ravel(), rtol=1e-12, atol=1e-13)
            np.testing.assert_allclose(row[4:], bend[np.triu_indices(3)], rtol=1e-11, atol=1e-12)
        for order in (0, 1):
            less = tape(x, given, order)
            np.testing.assert_array_equal(less, found[:, :, : less.shape[2]])


def test_an_operation_that_the_tape_lacks_is_told():
    with pytest.raises(NotImplementedError, match="no operation"):
        tape_of(X, S, ca.tanh(a))


@pytest.mark.parametrize("name", ["paper", "skewed0", "skewed1"])
def test_the_light_on_a_facet_reaches_as_far_as_the_ranges_have_it(name):
    sensor = SENSORS[name]
    state = ca.SX.sym("state", 8)
    fixed = build_geometry(tuple(map(ca.SX, parameters(sensor))))
    sizes = [(psd.size_y, psd.size_z) for psd in sensor.psds]
    parts = edge_clearances(fixed, tuple(state[i] for i in range(8)), sizes)
    least = ca.vertcat(*[ca.mmin(ca.vertcat(*part)) for part in parts.values()])
    function = ca.Function("clearances", [state], [least])
    for offset, angle in ((0.05, 0.3), (0.2, 0.02)):
        for place in states(40, seed=3, offset=offset, angle=angle):
            expected = facets.margins(sensor, place)[:, :4].ravel()
            if np.isfinite(expected).all():
                found = np.array(function(place)).ravel()
                np.testing.assert_allclose(found, expected, atol=1e-9)
