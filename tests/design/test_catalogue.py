"""Parts of a catalogue: the best is found, though few of many are tried."""

from __future__ import annotations

from dataclasses import replace

import pytest

import facets
from facets import optimize
from facets.core import LaserPart, PsdPart

CONFIG = facets.load("layout")
MARKET = facets.load("market").layout
FREE = float("inf")


def layout_of(psds, lasers, amplifiers):
    """With parts of the market, and a head that is to be small and cheap."""
    return replace(
        CONFIG.layout, variables={"radius_mm": (30.0, 300.0)}, starts=1, head=FREE, aim="weighted",
        weights={"size": 1.0, "price": 0.5}, limit=(FREE, FREE, 4.0, 14.0, 14.0, FREE),
        psds={name: MARKET.psds[name] for name in psds},
        lasers={name: MARKET.lasers[name] for name in lasers},
        amplifiers={name: MARKET.amplifiers[name] for name in amplifiers},
    )  # fmt: skip


@pytest.mark.slow
def test_the_best_of_a_large_catalogue_is_that_of_trying_all():
    """Of 32 choices some are left out; both halves of them are small, so that all are tried."""
    psds = ["duo-10", "duo-15", "tetra-10", "tetra-20"]
    lasers, amplifiers = list(MARKET.lasers)[:4], list(MARKET.amplifiers)[2:4]
    whole, *halves = (
        optimize(CONFIG.sensor, layout_of(some, lasers, amplifiers))
        for some in (psds, psds[:2], psds[2:])
    )
    assert whole.choices == 32
    assert len(whole.tried) < 32
    assert [len(half.tried) for half in halves] == [16, 16]
    choice, result = min(
        (pair for half in halves for pair in half.tried if pair[1].found),
        key=lambda pair: pair[1].objective,
    )
    assert whole.best.found
    assert whole.tried[0][0] == choice
    assert whole.tried[0][1].objective == pytest.approx(result.objective, rel=1e-6)


@pytest.mark.slow
def test_a_choice_is_optimised_as_the_sensor_with_its_parts():
    psds = {"small": PsdPart(8.0, 0.0016, 100.0), "large": PsdPart(20.0, 0.004, None)}
    lasers = {"dim": LaserPart(0.3, 0.85, 50.0), "bright": LaserPart(1.0, 0.85, 500.0)}
    layout = replace(CONFIG.layout, variables={"radius_mm": (100.0, 250.0)}, starts=1)
    result = optimize(CONFIG.sensor, replace(layout, psds=psds, lasers=lasers))
    prices = {tuple(choice.names[:2]): choice.price for choice, _ in result.tried}
    assert len(prices) == 4
    assert prices["small", "dim"] == 350
    assert prices["large", "dim"] is None
    choice, best = result.tried[0]
    assert choice.names[1] == "bright"
    part = psds[choice.names[0]]
    sensor = replace(
        CONFIG.sensor,
        noise=replace(CONFIG.sensor.noise, position=part.position),
        beam=replace(CONFIG.sensor.beam, power=1.0),
        psds=tuple(replace(p, size_y=part.size, size_z=part.size) for p in CONFIG.sensor.psds),
    )
    alone = optimize(sensor, layout).best
    assert alone.found
    assert best.objective == pytest.approx(alone.objective)
