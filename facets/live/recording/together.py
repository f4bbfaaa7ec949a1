"""Many blocks followed and solved at once, as a replay can, to the same bits as one by one.

What one block costs beside its samples is many times the cost of the samples. The samples of blocks
are followed together where each is the next one of the sample before; their batches are solved
together where each is then counted as alone. Else both halves are tried.
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
    """Yield the poses of batches as `Pipeline.solve` gives them, those of many batches at once: of
    those with as good a place of the beam, up to the next look at the doubts."""
    first, seen = 0, pipeline.doubts.samples
    for n, batch in enumerate(batches):
        is_other = batch.place_sigma != batches[first].place_sigma
        if n > first and (seen >= LOOKED_AT or is_other):
            yield from solve_together(pipeline, batches[first:n])
            first, seen = n, pipeline.doubts.samples
        seen += len(batch)
    if batches:
        yield from solve_together(pipeline, batches[first:])


def solve_together(pipeline: Pipeline, batches: Sequence[Batch]) -> Iterator[RunPoses]:
    """Yield the poses of batches, together where each is then counted as alone."""
    if len(batches) == 1 or pipeline.board.came:
        yield from map(pipeline.solve, batches)
        return
    whole = join(batches)
    ends = np.cumsum(list(map(len, batches)))
    samples = replace(samples_of(pipeline.config, whole), ends=ends)
    poses = pipeline.measurement.poses_of_pieces(samples)
    if poses is not None:
        yield pipeline.screen_poses(whole, samples, poses)
        return
    for part in halves(batches):
        yield from solve_together(pipeline, part)


def halves(parts: Sequence[Any]) -> tuple[Sequence[Any], Sequence[Any]]:
    return parts[: len(parts) // 2], parts[len(parts) // 2 :]
