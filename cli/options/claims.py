"""The claim that `facets jacobian --certify` proves: for which sensors and states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from facets import characterization, proof

if TYPE_CHECKING:
    from facets.characterization.state_box import StateBox
    from facets.config import Config
    from facets.core.units import Floats
    from facets.proof.tolerances import Tolerances


@dataclass(frozen=True)
class Claim:
    """A claim to prove, with its sensors and states.

    least_share: of the light, on each facet; None for the least anywhere in the box with its
    offsets.  weakest: the weakest state that a search found, where to begin to look for a
    counterexample.
    """

    settings: Config
    box: StateBox
    least_share: float | None
    tolerances: Tolerances | None
    weakest: Floats | None

    @property
    def largest_power(self) -> float:
        """The largest power of the laser for which the claim is made, mW."""
        power = self.settings.sensor.beam.power
        return power if self.deviations is None else power + self.deviations[0]

    @property
    def deviations(self) -> tuple[float, ...] | None:
        return None if self.tolerances is None else self.tolerances.values


def claim_for(
    settings: Config,
    box: StateBox,
    least_share: float | None,
    factor: float | None,
    weakest: Floats | None,
) -> Claim:
    """factor: of the standard uncertainties that are allowed for; None for the sensor as it is."""
    known = None if factor is None else proof.tolerances.calibration_tolerances(settings, factor)
    if least_share is not None and known is not None:
        least_share = characterization.state_box.least_share(
            settings.sensor, settings.range, known.values[0]
        )
    return Claim(settings, box, least_share, known, weakest)
