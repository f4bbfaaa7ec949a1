"""Follow and solve many blocks of a replay at once, with the same results to the last bit.

The fixed cost of a block is many times the cost of its samples. Blocks are followed together if all
their samples are consecutive, and their batches are solved together if each batch then counts as it
would alone. Otherwise each half is tried by itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..run.doubts import LOOKED_AT
from ..run.pipeline import Batch, ParsedBlock, Pipeline, RunPoses, join, samples_of
from ..sources.frames import POSE, RawSamples
from ..sources.source import Block


def solve_blocks(pipeline: Pipeline, blocks: Sequence[Block]) -> Iterator[RunPoses]:
    """Yield the poses of blocks as `Pipeline.feed` returns them, those of many blocks at once."""
    feed = pipeline.parser.feed
    parsed = (ParsedBlock(feed(block.data), block.arrival, block.encoder) for block in blocks)
    yield from follow_blocks(pipeline, [block for block in parsed if len(block.samples)])


def follow_blocks(pipeline: Pipeline, blocks: Sequence[ParsedBlock]) -> Iterator[RunPoses]:
    """Yield the poses of blocks with samples, followed together if all samples are consecutive."""
    if len(blocks) < 2 or are_consecutive(pipeline, join([block.samples for block in blocks])):
        yield from solve_batches(pipeline, pipeline.follow(blocks) if blocks else [])
        return
    for part in halves(blocks):
        yield from follow_blocks(pipeline, part)


def are_consecutive(pipeline: Pipeline, samples: RawSamples) -> bool:
    """Whether samples directly continue the newest one, without poses of the board among them."""
    return bool((samples.kind != POSE).all()) and pipeline.sequence.continues(samples)


def solve_batches(pipeline: Pipeline, batches: Sequence[Batch]) -> Iterator[RunPoses]:
    """Yield the poses of batches as `Pipeline.solve` returns them, those of many batches at once.

    Batches are solved together while the uncertainty of the beam's position is the same, and up to
    the next update of the doubts.
    """
    first, count = 0, pipeline.doubts.samples
    for n, batch in enumerate(batches):
        is_other = batch.place_sigma != batches[first].place_sigma
        if n > first and (count >= LOOKED_AT or is_other):
            yield from solve_together(pipeline, batches[first:n])
            first, count = n, pipeline.doubts.samples
        count += len(batch)
    if batches:
        yield from solve_together(pipeline, batches[first:])


def solve_together(pipeline: Pipeline, batches: Sequence[Batch]) -> Iterator[RunPoses]:
    """Yield the poses of batches, solved together if each then counts as it would alone."""
    if len(batches) == 1 or pipeline.board.came:
        yield from map(pipeline.solve, batches)
        return
    joined = join(batches)
    ends = np.cumsum(list(map(len, batches)))
    samples = replace(samples_of(pipeline.config, joined), ends=ends)
    poses = pipeline.measurement.poses_of_pieces(samples)
    if poses is not None:
        yield pipeline.screen_poses(joined, samples, poses)
        return
    for part in halves(batches):
        yield from solve_together(pipeline, part)


def halves(parts: Sequence[Any]) -> tuple[Sequence[Any], Sequence[Any]]:
    """The first and the second half of some parts."""
    return parts[: len(parts) // 2], parts[len(parts) // 2 :]
