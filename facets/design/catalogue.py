"""Parts that can be bought: every choice of them, and the sensor with each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

from ..core.sensor import Sensor

if TYPE_CHECKING:
    from ..core.settings import Layout


@dataclass(frozen=True)
class Choice:
    """Parts from the catalogue, "" where it has none of the kind.  price: of three detectors and
    the laser, None where one is not known."""

    psd: str
    laser: str
    price: float | None


def choices(sensor: Sensor, layout: Layout) -> Iterator[tuple[Choice, Sensor]]:
    """Every choice of parts and the sensor with it."""
    for psd, laser in product(layout.psds or [""], layout.lasers or [""]):
        made, prices = sensor, []
        if psd:
            part = layout.psds[psd]
            prices.append(None if part.price is None else 3 * part.price)
            a, b, c = (replace(p, size_y=part.size, size_z=part.size) for p in made.psds)
            position = made.noise.position if part.position is None else part.position
            made = replace(made, psds=(a, b, c), noise=replace(made.noise, position=position))
        if laser:
            source = layout.lasers[laser]
            prices.append(source.price)
            beam = replace(made.beam, power=source.power)
            if "diameter_mm" not in layout.variables:  # else a telescope makes it
                beam = replace(beam, diameter_x=source.diameter, diameter_y=source.diameter)
            made = replace(made, beam=beam)
        known = [price for price in prices if price is not None]
        yield Choice(psd, laser, sum(known) if len(known) == len(prices) else None), made
