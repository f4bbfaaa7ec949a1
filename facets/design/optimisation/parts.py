"""The best choice from a catalogue of parts, and the sensor with these parts.

A large catalogue is searched by branch and bound. A branch is a set of parts of each kind. Its
bound is the best layout with ideal parts, each as good as the best of the branch in every respect.
These are the largest detector with the least noise, and the strongest laser with any of the
diameters, at the lowest price. No choice of the branch can be better. A branch is therefore dropped
if its bound is worse than a known choice, or if even the bound's layout violates a requirement;
every other branch is split in two. The bound is only as reliable as one search is at finding the
best layout.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count, product
from math import prod
from typing import TYPE_CHECKING, Any

from ...core.sensor import Sensor

if TYPE_CHECKING:
    from ...core.layout import Layout
    from .problem import StartResult

#: Largest number of choices of a catalogue that is tried in full, so that the user can see them.
TRIED = 24
#: A branch is dropped if its bound exceeds the best known objective by this fraction of it.
WORSE = 1e-6
#: Prices are counted in thousands in a weighted sum.
THOUSAND = 1000.0
#: Number of parts of each kind: detectors, lasers, sets of amplifiers.
NUMBERS = (3, 1, 1)
#: Names of a branch's parts of each kind, "" for a kind that the catalogue lacks.
Branch = tuple[tuple[str, ...], ...]
#: The parts of each kind by name.
Catalogue = tuple[dict[str, Any], ...]
Search = Callable[[Sensor, "Layout"], "StartResult"]


@dataclass(frozen=True)
class PartsChoice:
    """A detector, a laser and amplifiers from the catalogue, as a branch of one part of each kind.

    price: of three detectors, the laser and the amplifiers; None if one of them has no price.
    delivery: weeks until all parts arrive; None if one of them has no time."""

    parts: Branch
    price: float | None
    delivery: float | None = None

    @property
    def names(self) -> list[str]:
        """The names of the chosen parts."""
        return [name for (name,) in self.parts]


def choice_of(catalogue: Catalogue, branch: Branch) -> PartsChoice:
    """The choice that a branch with one part of each kind represents."""
    kinds = zip(catalogue, branch, NUMBERS, strict=True)
    chosen = [(kind[name], number) for kind, (name,), number in kinds if name]
    prices: list[float | None] = [
        None if part.price is None else number * part.price for part, number in chosen
    ]
    waits = [part.delivery for part, _ in chosen]
    return PartsChoice(
        branch,
        None if None in prices else sum(price for price in prices if price),
        None if None in waits else max(waits),
    )


def price_term(layout: Layout, price: float | None) -> float:
    """Return the term that a price adds to the objective."""
    weight = layout.weights.get("price", 0.0) if layout.aim == "weighted" else 0.0
    return weight * (price or 0.0) / THOUSAND


def sorted_parts(catalogue: Catalogue) -> Branch:
    """Return the branch with all parts of the catalogue, similar parts next to each other."""
    psds, lasers, amplifiers = catalogue
    return (
        tuple(sorted(psds, key=lambda n: (psds[n].size, psds[n].position or 0)) or [""]),
        tuple(sorted(lasers, key=lambda n: (lasers[n].diameter, lasers[n].power)) or [""]),
        tuple(sorted(amplifiers, key=lambda n: amplifiers[n].power) or [""]),
    )


def single_branches(catalogue: Catalogue) -> list[Branch]:
    """List every choice of the catalogue as a branch of its own."""
    kinds = (tuple(kind) or ("",) for kind in catalogue)
    return [tuple((name,) for name in names) for names in product(*kinds)]


def halves_of(branch: Branch) -> list[Branch]:
    """Split a branch in two, by the kind of which it has most parts."""
    kind = max(range(len(branch)), key=lambda n: len(branch[n]))
    names, middle = branch[kind], len(branch[kind]) // 2
    return [
        (*branch[:kind], half, *branch[kind + 1 :]) for half in (names[:middle], names[middle:])
    ]


def relax_parts(sensor: Sensor, layout: Layout, branch: Branch) -> tuple[Sensor, Layout]:
    """Return the sensor with parts as good as the best of the branch in every respect, and its
    layout."""
    relaxed, variables = sensor, layout.variables
    if branch[0][0]:
        psds = [layout.psds[name] for name in branch[0]]
        side, present = max(part.size for part in psds), sensor.noise.position
        position = min(present if part.position is None else part.position for part in psds)
        a, b, c = (replace(psd, size_y=side, size_z=side) for psd in relaxed.psds)
        relaxed = replace(relaxed, psds=(a, b, c), noise=replace(relaxed.noise, position=position))
    if branch[1][0]:
        lasers = [layout.lasers[name] for name in branch[1]]
        beam = replace(relaxed.beam, power=max(part.power for part in lasers))
        widths = [part.diameter for part in lasers]
        if "diameter_mm" not in variables:  # else a telescope sets it
            beam = replace(beam, diameter_x=min(widths), diameter_y=min(widths))
        if min(widths) < max(widths):
            variables = {**variables, "diameter_mm": (min(widths), max(widths))} | variables
        relaxed = replace(relaxed, beam=beam)
    if branch[2][0]:
        power = min(layout.amplifiers[name].power for name in branch[2])
        relaxed = replace(relaxed, noise=replace(relaxed.noise, power=power))
    return relaxed, replace(layout, variables=variables, psds={}, lasers={}, amplifiers={})


def lowest_price(catalogue: Catalogue, branch: Branch) -> float:
    """The lowest price of a choice in the branch; a part without a price counts as zero."""
    return sum(
        number * min(kind[name].price or 0.0 for name in names)
        for kind, names, number in zip(catalogue, branch, NUMBERS, strict=True)
        if kind
    )


def best_parts(
    sensor: Sensor, layout: Layout, search: Search, on_progress: Callable[[int, int], None]
) -> tuple[list[tuple[PartsChoice, StartResult]], int]:
    """Search for the best choice; return the searched choices with their results, the best first,
    and the number of all choices.

    search: finds the best layout of a sensor, from the present one.  on_progress: called with the
    number of choices that are decided and the number of all choices.
    """
    catalogue = layout.psds, layout.lasers, layout.amplifiers
    root = sorted_parts(catalogue)
    total, number = prod(map(len, root)), count()
    branches = single_branches(catalogue) if total <= TRIED else [root]
    queue = [(float("-inf"), next(number), branch) for branch in branches]
    tried: list[tuple[PartsChoice, StartResult]] = []
    settled, best = 0, float("inf")
    while queue:
        bound, _, branch = heapq.heappop(queue)
        if bound > best + WORSE * abs(best):
            break  # the bounds of all remaining branches are worse, too
        on_progress(settled, total)
        choices = prod(map(len, branch))
        end = search(*relax_parts(sensor, layout, branch))
        end.objective += price_term(layout, lowest_price(catalogue, branch))
        if choices > 1 and end.found and end.objective <= best + WORSE * abs(best):
            for half in halves_of(branch):
                heapq.heappush(queue, (end.objective, next(number), half))
            continue
        settled += choices
        if choices == 1:
            tried.append((choice_of(catalogue, branch), end))
            best = min(best, end.objective) if end.found else best
    if not tried:  # no choice meets the requirements, not even with parts as good as any
        last: Branch = tuple(names[-1:] for names in root)
        tried.append((choice_of(catalogue, last), search(*relax_parts(sensor, layout, last))))
    tried.sort(key=lambda pair: (not pair[1].found, pair[1].objective, pair[0].price or 0))
    return tried, total
