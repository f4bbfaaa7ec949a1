"""Parts of a catalogue: branch and bound finds what trying all of them finds."""

from __future__ import annotations

from dataclasses import replace

import pytest

import facets
from facets import optimize
from facets.design import solve_from_present
from facets.design.branching import best_parts, relax_parts, whole
from facets.design.catalogue import choices

CONFIG = facets.load("layout")
MARKET = facets.load("market").layout


def layout_of(psds, lasers, amplifiers, **more):
    """The parts whose names begin so, and a head that is to be small, or cheap as well."""
    kinds = ((MARKET.psds, psds), (MARKET.lasers, lasers), (MARKET.amplifiers, amplifiers))
    some = [{n: part for n, part in parts.items() if n in names} for parts, names in kinds]
    inf = float("inf")
    return replace(
        CONFIG.layout, variables={"radius_mm": (30.0, 300.0)}, starts=1, head=inf, aim="size",
        limit=(inf, inf, 4.0, 14.0, 14.0, inf), psds=some[0], lasers=some[1], amplifiers=some[2],
        **more,
    )  # fmt: skip


def test_the_market_has_what_it_says():
    assert (len(MARKET.psds), len(MARKET.lasers), len(MARKET.amplifiers)) == (50, 20, 10)


@pytest.mark.parametrize("weights", [{"size": 1.0}, {"size": 1.0, "price": 2.0}])
@pytest.mark.slow
def test_branch_and_bound_is_enumeration(weights):
    layout = layout_of(
        ["duo-10", "duo-15", "tetra-20"], ["diode-1", "fibre-2"], ["amplifiers-20nw"]
    )
    layout = replace(layout, aim="weighted", weights=weights)
    tried = optimize(CONFIG.sensor, layout).tried  # a small catalogue: all of it
    assert len(tried) == len(list(choices(CONFIG.sensor, layout))) == 6
    found = best_parts(CONFIG.sensor, layout, solve_from_present)
    assert found.tried[0][1].found
    assert found.tried[0][1].objective == pytest.approx(tried[0][1].objective, rel=1e-6)
    assert found.tried[0][0] == tried[0][0]
    assert found.choices == 6


@pytest.mark.slow
def test_a_bound_is_no_worse_than_any_choice():
    layout = layout_of(["duo-10", "tetra-20"], ["diode-1", "fibre-2"], ["amplifiers-20nw"])
    bound = solve_from_present(*relax_parts(CONFIG.sensor, layout, whole(layout)))
    for _, sensor in choices(CONFIG.sensor, layout):
        end = solve_from_present(sensor, layout)
        assert not end.found or end.objective > bound.objective - 1e-7


def few_of(psds, lasers, amplifiers):
    """Looks for the best of a large catalogue; the result."""
    layout = layout_of(psds, lasers, amplifiers)
    layout = replace(layout, aim="weighted", weights={"size": 1.0, "price": 0.5})
    found = optimize(CONFIG.sensor, layout)
    assert found.choices == len(psds) * len(lasers) * len(amplifiers)
    assert found.best.found
    assert 0 < len(found.tried) < found.choices / 10
    best = found.tried[0][0]
    assert best.price is not None
    assert best.delivery is not None
    return found


@pytest.mark.slow
def test_of_a_large_catalogue_few_are_looked_at():
    few_of(list(MARKET.psds)[:20], list(MARKET.lasers)[:8], list(MARKET.amplifiers)[2:6])


@pytest.mark.study
def test_of_the_whole_market_few_are_looked_at():
    found = few_of(list(MARKET.psds), list(MARKET.lasers), list(MARKET.amplifiers))
    assert len(found.tried) < 100


@pytest.mark.slow
def test_a_catalogue_that_can_not_do_it_says_what_stands_against_what():
    layout = layout_of(list(MARKET.psds), ["diode-0.5"], ["amplifiers-200nw"])
    found = optimize(CONFIG.sensor, replace(layout, limit=(float("inf"),) * 2 + (0.01,) * 4))
    assert not found.best.found
    assert found.best.shortfalls
