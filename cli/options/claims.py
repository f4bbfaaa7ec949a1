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

    least_share: least fraction of the light on each facet; None: the least anywhere in the box with
    its offsets.  weakest: the weakest state that a search found, at which the search for a
    counterexample starts.
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
    """Make the claim for a box.

    factor: number of standard uncertainties within which the sensor's parameters lie; None: they
    are exact.
    """
    tolerances = (
        None if factor is None else proof.tolerances.calibration_tolerances(settings, factor)
    )
    if least_share is not None and tolerances is not None:
        least_share = characterization.state_box.least_share(
            settings.sensor, settings.range, tolerances.values[0]
        )
    return Claim(settings, box, least_share, tolerances, weakest)
