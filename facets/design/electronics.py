"""The noise of detectors with their electronics, in symbols: `detectors.noise` for the optimiser.

Of the kinds whose currents are plain formulas of the place, duo-lateral and pincushion; those of a
tetra-lateral are a series (`detectors.electrodes`), which the optimiser's tape can not hold.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..core.sensor import Electronics
from ..detectors.noise import CHARGE, current_variances, has_two_layers

#: Of an amplifier's full scale, what the light of a design may take; the rest is for the laser's
#: noise, for parts that differ, and for the noise of the reading itself.
FULL = 0.95
#: By kind, for psi and for zeta: the electrodes that light moves away from, and towards.
PAIRS = {
    "duo-lateral": (((0,), (1,)), ((2,), (3,))),
    "pincushion": (((0, 2), (1, 3)), ((0, 1), (2, 3))),
}


def currents_of(electronics: Electronics, values: Any, halves: tuple[Any, Any]) -> list[Any]:
    """The four electrodes' currents, A, of a reading (psi, zeta, power)."""
    y, z = values[0] / halves[0], values[1] / halves[1]
    light = 1e-3 * electronics.responsivity * values[2]
    if has_two_layers(electronics):
        parts = [(1 - y) / 2, (1 + y) / 2, (1 - z) / 2, (1 + z) / 2]
    else:
        parts = [(1 - y) * (1 - z) / 4, (1 + y) * (1 - z) / 4,
                 (1 - y) * (1 + z) / 4, (1 + y) * (1 + z) / 4]  # fmt: skip
    return [light * part for part in parts]


def even_variance(electronics: Electronics, gain: Any) -> Any:
    """Of an electrode's current, what does not depend on its light, A^2.  gain: ohm."""
    import numpy as np

    # the amplifier's part is what it would be without its resistor, and one that goes as 1 / gain
    dark = current_variances(electronics, np.zeros(1))[0]
    own = electronics.transimpedance
    endless = current_variances(replace(electronics, transimpedance=1e300), np.zeros(1))[0]
    thermal = (dark[3] - endless[3]) * own
    return dark[1] + dark[2] + endless[3] + thermal / gain + dark[4] * (own / gain) ** 2


def deviations(
    electronics: Electronics, values: Any, halves: tuple[Any, Any], gain: Any
) -> tuple[list[Any], list[Any]]:
    """The standard deviations of psi, zeta (mm) and power (mW); and what is left of each of the
    four amplifiers' full scale, as a share."""
    import casadi as ca

    currents = currents_of(electronics, values, halves)
    shot = 2 * CHARGE * electronics.bandwidth
    even = even_variance(electronics, gain)
    var = [shot * current + even for current in currents]
    found = []
    for (low, high), half in zip(PAIRS[electronics.kind], halves, strict=True):
        below, above = sum(currents[i] for i in low), sum(currents[i] for i in high)
        square = above**2 * sum(var[i] for i in low) + below**2 * sum(var[i] for i in high)
        found.append(2 * half * ca.sqrt(square) / (below + above) ** 2)
    whole = sum(var) / (4 if has_two_layers(electronics) else 1)
    found.append(ca.sqrt(whole) / (1e-3 * electronics.responsivity))
    full = FULL * electronics.adc_range / gain
    return found, [1 - current / full for current in currents]
