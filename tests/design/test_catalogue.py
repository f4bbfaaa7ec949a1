"""Parts of a catalogue: the best is found, though few of many are tried."""

from __future__ import annotations

from dataclasses import replace

import pytest

import facets
from facets import optimize
from facets.core import LaserPart, PsdPart

CONFIG = facets.load("layout")
MARKET = facets.load("market").layout
WEIGHTS = {"size": 1.0, "price": 0.5}


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


@pytest.mark.slow
def test_the_best_of_a_large_catalogue_is_that_of_trying_all():
    """Of 32 choices some are left out; both halves of them are small, so that all are tried."""
    psds = ["duo-10", "duo-15", "tetra-10", "tetra-20"]
    lasers, amplifiers = list(MARKET.lasers)[:4], list(MARKET.amplifiers)[2:4]
    assert {*psds} <= {*MARKET.psds}

    def search(some):
        layout = layout_of(some, lasers, amplifiers)
        return optimize(CONFIG.sensor, replace(layout, aim="weighted", weights=WEIGHTS))

    whole = search(psds)
    halves = [search(psds[:2]), search(psds[2:])]
    assert whole.choices == 32
    assert len(whole.tried) < 32
    assert [len(half.tried) for half in halves] == [16, 16]
    choice, result = min(
        (pair for half in halves for pair in half.tried if pair[1].found),
        key=lambda pair: pair[1].objective,
    )
    assert whole.tried[0][1].found
    assert whole.tried[0][0] == choice
    assert whole.tried[0][1].objective == pytest.approx(result.objective, rel=1e-6)


@pytest.mark.slow
def test_a_choice_is_optimised_as_the_sensor_with_its_parts():
    psds = {"small": PsdPart(8.0, 0.0016, 100.0), "large": PsdPart(20.0, 0.004, None)}
    lasers = {"dim": LaserPart(0.3, 0.85, 50.0), "bright": LaserPart(1.0, 0.85, 500.0)}
    layout = replace(CONFIG.layout, variables={"radius_mm": (100.0, 250.0)}, starts=1)
    result = optimize(CONFIG.sensor, replace(layout, psds=psds, lasers=lasers))
    prices = {(choice.psd, choice.laser): choice.price for choice, _ in result.tried}
    assert len(prices) == 4
    assert prices["small", "dim"] == 350
    assert prices["large", "dim"] is None
    choice, best = result.tried[0]
    assert choice.laser == "bright"
    part = psds[choice.psd]
    sensor = replace(
        CONFIG.sensor,
        noise=replace(CONFIG.sensor.noise, position=part.position),
        beam=replace(CONFIG.sensor.beam, power=1.0),
        psds=tuple(replace(p, size_y=part.size, size_z=part.size) for p in CONFIG.sensor.psds),
    )
    alone = optimize(sensor, layout).best
    assert alone.found
    assert best.objective == pytest.approx(alone.objective)


@pytest.mark.slow
def test_a_catalogue_that_can_not_do_it_says_what_stands_against_what():
    layout = layout_of(list(MARKET.psds), ["diode-0.5"], ["amplifiers-200nw"])
    found = optimize(CONFIG.sensor, replace(layout, limit=(float("inf"),) * 2 + (0.01,) * 4))
    assert not found.best.found
    assert found.best.shortfalls
