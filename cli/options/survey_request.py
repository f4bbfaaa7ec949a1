"""The request of `facets jacobian`: a sample, its box of states, and the results' files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from facets import characterization
from facets.core.errors import InputError

if TYPE_CHECKING:
    from facets.characterization.state_box import StateBox
    from facets.config import Config


@dataclass(frozen=True)
class SurveyRequest:
    """The survey that the command line requests."""

    settings: Config
    domain: StateBox
    least_share: float | None
    states: int
    seed: int
    left_out: str
    folder: Path
    plot: str
    certify: bool

    @property
    def picture(self) -> Path:
        return self.folder / f"jacobian.{self.plot}"

    @property
    def certificate(self) -> Path:
        return self.folder / "certificate.json"

    @property
    def names(self) -> list[str]:
        """Names of all files that may be written."""
        names = [self.picture.name, "density.csv", "run.yaml"]
        return names + [self.certificate.name] * self.certify


def choose_box(settings: Config, box: str | None) -> tuple[StateBox, float | None]:
    """Return the box, and the least share of light for a proof, by the rules or by the box."""
    if box is not None:
        return characterization.state_box.parse_box(box), None
    sensor, rules = settings.sensor, settings.range
    return characterization.state_box.range_box(
        sensor, rules
    ), characterization.state_box.least_share(sensor, rules)


#: Sampling that takes longer than this, s, is announced.
ANNOUNCED_AFTER_S = 10.0


def refuse_too_many(request: SurveyRequest) -> None:
    """Print how long many states take; raise `InputError` for too many."""
    if request.states <= characterization.singularity.CHUNK:
        return
    seconds, memory = characterization.singularity.cost(
        request.settings.sensor, request.domain, request.states, request.left_out
    )
    about = f"about {duration(seconds)} on one core and {memory / 1e6:.0f} MB of memory"
    if request.states > characterization.singularity.MAX_STATES:
        most = characterization.singularity.MAX_STATES
        asks = f"--states is {request.states:,}; allowed: up to {most:,}"
        raise InputError(f"{asks}; these would take {about}")
    if seconds > ANNOUNCED_AFTER_S:
        typer.echo(f"{request.states:,} states take {about}", err=True)


def duration(seconds: float) -> str:
    """Write a duration in a suitable unit: "2.5 h"."""
    for unit, size in (("days", 86_400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.2g} s"
