"""Compile the blocks that a command is about to need, in parallel.

Otherwise each is compiled at its first use, one after the other; results are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

from ..core.knowledge import Knowledge
from ..core.sensor import Sensor
from ..model import blocks as of_model
from ..model.arrays import kernel_name
from ..model.kinds import LIT, kind_of
from ..model.threads import run_side_by_side
from . import blocks
from .block_task import Form
from .plan import make_plan

Task = Literal[
    "readings", "derivatives", "approximate_derivatives", "footprints", "slopes", "poses"
]
Makers = list[Callable[[], Any]]


def compile_for(
    sensor: Sensor,
    *tasks: Task,
    knowledge: Knowledge | None = None,
    kinds: Sequence[str] = (),
) -> None:
    """Compiles or loads what a sensor's tasks take.

    tasks: results of `facets.model`, "slopes" being derivatives by parameters; "poses" those of
    `facets.solve`.  knowledge: of the beam, for "poses"; by default its position is free.
    kinds: of `model.kinds.LIT`, whose slopes by the numbers of the light are asked for, too.
    """
    makers: Makers = []
    for task in tasks:
        if task == "poses":
            makers += estimators(sensor, knowledge or Knowledge())
        elif task == "slopes":
            makers += slopes(kind_of(sensor), kinds)
        else:
            makers.append(partial(of_model.kernel, kernel_name(sensor, task)))
    run_side_by_side(makers)


def slopes(own: str, kinds: Sequence[str]) -> Makers:
    """own: the kind of light that is on, see `model.kinds.kind_of`."""
    names = [f"slopes_of_{kind}" for kind in {*kinds, own} & {*LIT, "cut"}]
    if own == "plain":
        names.append("slopes_by_parameters")
    return [partial(of_model.slopes_kernel, name) for name in names]


def estimators(sensor: Sensor, knowledge: Knowledge) -> Makers:
    """What makes the blocks that estimate poses, and those by which doubts are told."""
    free = tuple(make_plan(sensor, knowledge).free.tolist())
    makers: Makers = [partial(blocks.kernel, Form(free, kind_of(sensor)))]
    if 6 in free:
        makers.append(partial(of_model.kernel, "derivatives"))  # `doubts.has_fold`
    return makers
