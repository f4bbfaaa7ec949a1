"""Parts that can be bought: every choice of them, and the sensor with each choice."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

from ..core.sensor import Sensor

if TYPE_CHECKING:
    from ..core.layout import Layout


@dataclass(frozen=True)
class PartsChoice:
    """Parts from the catalogue, "" for a kind that it lacks.  price: of three detectors, the laser
    and the amplifiers, None if a price is not known.  delivery: weeks until all parts are there,
    None if a time is not known."""

    psd: str
    laser: str
    price: float | None
    amplifier: str = ""
    delivery: float | None = None

    @property
    def names(self) -> str:
        return " ".join(name for name in (self.psd, self.laser, self.amplifier) if name)


def total(prices: Iterable[float | None]) -> float | None:
    """Return the sum; None if a price is not known or there is no price."""
    known = list(prices)
    return None if not known or None in known else sum(price for price in known if price)


def choices(sensor: Sensor, layout: Layout) -> Iterator[tuple[PartsChoice, Sensor]]:
    """Yield every choice of parts and the sensor with it."""
    kinds = (layout.psds or [""], layout.lasers or [""], layout.amplifiers or [""])
    for psd, laser, amplifier in product(*kinds):
        yield (
            choice_of(layout, psd, laser, amplifier),
            replace_parts(sensor, layout, psd, laser, amplifier),
        )


def choice_of(layout: Layout, psd: str, laser: str, amplifier: str) -> PartsChoice:
    prices: list[float | None] = []
    waits: list[float | None] = []
    if psd:
        part = layout.psds[psd]
        prices.append(None if part.price is None else 3 * part.price)
        waits.append(part.delivery)
    for name, parts in ((laser, layout.lasers), (amplifier, layout.amplifiers)):
        if name:
            prices.append(parts[name].price)
            waits.append(parts[name].delivery)
    known = [wait for wait in waits if wait is not None]
    latest = max(known) if known and len(known) == len(waits) else None
    return PartsChoice(psd, laser, total(prices), amplifier, latest)


def replace_parts(sensor: Sensor, layout: Layout, psd: str, laser: str, amplifier: str) -> Sensor:
    """Return the sensor with the named parts; "" keeps the sensor's own part."""
    made = sensor
    if psd:
        part = layout.psds[psd]
        a, b, c = (replace(p, size_y=part.size, size_z=part.size) for p in made.psds)
        position = made.noise.position if part.position is None else part.position
        made = replace(made, psds=(a, b, c), noise=replace(made.noise, position=position))
    if amplifier:
        power = layout.amplifiers[amplifier].power
        made = replace(made, noise=replace(made.noise, power=power))
    if laser:
        source = layout.lasers[laser]
        beam = replace(made.beam, power=source.power)
        if "diameter_mm" not in layout.variables:  # else a telescope makes it
            beam = replace(beam, diameter_x=source.diameter, diameter_y=source.diameter)
        made = replace(made, beam=beam)
    return made
