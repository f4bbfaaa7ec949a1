"""The best parts of a large catalogue by branch and bound, without solving every choice.

A branch is a set of parts of each kind. Its bound is the best layout with parts that are as good as
any of them in everything at once: the largest detector with the least noise, the strongest laser
with any of the diameters, the lowest price. No choice of the branch can be better than that, so a
branch is dropped if its bound is worse than a known choice, or if even the bound's layout breaks a
requirement; every other branch is split in two. The bound is only as reliable as one search is at
finding the best layout.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from typing import TYPE_CHECKING

from ..core.sensor import Sensor
from .catalogue import PartsChoice, choice_of, replace_parts

if TYPE_CHECKING:
    from ..core.layout import Layout
    from .problem import StartResult

#: A branch is dropped if its bound is worse than the best known objective by more than this share.
WORSE = 1e-6
#: The name of a part that stands for several.
MERGED = "merged"
#: Prices are counted in thousands in a weighted sum.
THOUSAND = 1000.0
Search = Callable[[Sensor, "Layout"], "StartResult"]


@dataclass(frozen=True)
class Branch:
    """The names of a branch's parts, sorted, so that equal branches compare equal."""

    psds: tuple[str, ...]
    lasers: tuple[str, ...]
    amplifiers: tuple[str, ...]

    @property
    def choices(self) -> int:
        return len(self.psds) * len(self.lasers) * len(self.amplifiers)

    def halves(self) -> tuple[Branch, Branch]:
        """Split the branch by the kind of which it has most parts."""
        kinds = {"psds": self.psds, "lasers": self.lasers, "amplifiers": self.amplifiers}
        kind = max(kinds, key=lambda name: len(kinds[name]))
        middle = len(kinds[kind]) // 2
        return (
            replace(self, **{kind: kinds[kind][:middle]}),
            replace(self, **{kind: kinds[kind][middle:]}),
        )


def whole(layout: Layout) -> Branch:
    """Return the branch with all parts of the catalogue."""
    psds = sorted(layout.psds, key=lambda n: (layout.psds[n].size, layout.psds[n].position or 0))
    lasers = sorted(
        layout.lasers, key=lambda n: (layout.lasers[n].diameter, layout.lasers[n].power)
    )
    amplifiers = sorted(layout.amplifiers, key=lambda name: layout.amplifiers[name].power)
    return Branch(tuple(psds or [""]), tuple(lasers or [""]), tuple(amplifiers or [""]))


def relax_parts(sensor: Sensor, layout: Layout, branch: Branch) -> tuple[Sensor, Layout]:
    """Return the sensor with parts as good as any of the branch, and its layout."""
    variables, names, merged = layout.variables, ["", "", ""], layout
    if branch.psds[0]:
        psds = [layout.psds[name] for name in branch.psds]
        known_noise = sensor.noise.position
        noise = min(known_noise if part.position is None else part.position for part in psds)
        size, names[0] = max(part.size for part in psds), MERGED
        merged = replace(merged, psds={MERGED: replace(psds[0], size=size, position=noise)})
    if branch.lasers[0]:
        lasers = [layout.lasers[name] for name in branch.lasers]
        power, widths = max(part.power for part in lasers), [part.diameter for part in lasers]
        best, names[1] = replace(lasers[0], power=power, diameter=min(widths)), MERGED
        merged = replace(merged, lasers={MERGED: best})
        if min(widths) < max(widths):
            free = variables.get("diameter_mm", (min(widths), max(widths)))
            variables = variables | {"diameter_mm": free}
    if branch.amplifiers[0]:
        quietest, names[2] = (
            min(branch.amplifiers, key=lambda n: layout.amplifiers[n].power),
            MERGED,
        )
        merged = replace(merged, amplifiers={MERGED: layout.amplifiers[quietest]})
    made = replace_parts(sensor, merged, *names)
    return made, replace(layout, variables=variables, psds={}, lasers={}, amplifiers={})


def lowest_price(layout: Layout, branch: Branch) -> float:
    """The lowest price of a choice in the branch; a part without a price counts as zero."""
    total = 0.0
    for names, parts, times in (
        (branch.psds, layout.psds, 3), (branch.lasers, layout.lasers, 1),
        (branch.amplifiers, layout.amplifiers, 1),
    ):  # fmt: skip
        if names[0]:
            known: dict[str, float | None] = {name: part.price for name, part in parts.items()}
            total += times * min(known[name] or 0.0 for name in names)
    return total


def price_term(layout: Layout, price: float | None) -> float:
    """Return the term that a price adds to the objective."""
    weight = layout.weights.get("price", 0.0) if layout.aim == "weighted" else 0.0
    return weight * (price or 0.0) / THOUSAND


def best_parts(
    sensor: Sensor,
    layout: Layout,
    search: Search,
    on_progress: Callable[[int, int], None] = lambda done, whole: None,
) -> list[tuple[PartsChoice, StartResult]]:
    """Search for the best choice; return those that were solved with their results, best first.

    search: finds the best layout of a sensor from where it is.  on_progress: is called with the
    number of choices that are decided and the number of all choices.
    """
    root = whole(layout)
    tried: list[tuple[PartsChoice, StartResult]] = []
    queue: list[tuple[float, int, Branch]] = [(float("-inf"), 0, root)]
    number, settled, best = count(1), 0, float("inf")
    while queue:
        bound, _, branch = heapq.heappop(queue)
        if bound > best + WORSE * abs(best):
            break  # the bounds of all remaining branches are worse, too
        on_progress(settled, root.choices)
        if branch.choices == 1:
            settled += 1
            names = (branch.psds[0], branch.lasers[0], branch.amplifiers[0])
            choice = choice_of(layout, *names)
            end = search(replace_parts(sensor, layout, *names), layout)
            end.objective += price_term(layout, choice.price)
            tried.append((choice, end))
            best = min(best, end.objective) if end.found else best
            continue
        end = search(*relax_parts(sensor, layout, branch))
        value = end.objective + price_term(layout, lowest_price(layout, branch))
        if not end.found or value > best + WORSE * abs(best):
            settled += branch.choices
            continue
        for half in branch.halves():
            heapq.heappush(queue, (value, next(number), half))
    tried.sort(key=lambda pair: (not pair[1].found, pair[1].objective, pair[0].price or 0))
    return tried
