"""Many blocks taken in and solved at once, as a replay can, to the same bits as one by one.

What one block costs beside its samples is many times the cost of the samples. Blocks are taken in
together where their bytes are those of samples alone, each the next one of the sample before; their
batches are solved together where each is then counted as alone. Else both halves are tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isnan, nan
from typing import Any

import numpy as np

from ..run.doubts import LOOKED_AT
from ..run.pipeline import Batch, Pipeline, RunPoses, join
from ..sources.frames import POSE, RawSamples
from ..sources.source import Block


def solve_blocks(pipeline: Pipeline, blocks: Sequence[Block]) -> Iterator[RunPoses]:
    """Yield the poses of blocks as `Pipeline.feed` gives them, those of many blocks at once."""
    is_one = len(blocks) == 1
    batches = pipeline.take(*blocks[0][:3]) if is_one else take_together(pipeline, blocks)
    if batches is not None:
        yield from solve_batches(pipeline, batches)
        return
    for part in halves(blocks):
        yield from solve_blocks(pipeline, part)


def take_together(pipeline: Pipeline, blocks: Sequence[Block]) -> list[Batch] | None:
    """Return what `Pipeline.take` returns of each block; None, and take none, where what becomes of
    their samples depends on the blocks."""

    def go_on(samples: RawSamples) -> bool:
        is_solved = samples.kind == POSE
        return len(samples) > 0 and not is_solved.any() and sequence.continues(samples)

    sequence, times = pipeline.sequence, pipeline.times
    parsed = pipeline.parser.feed_together([block.data for block in blocks], go_on)
    if parsed is None:
        return None
    samples, counts = parsed
    pieces = [(count, block) for count, block in zip(counts, blocks, strict=True) if count]
    known = [block.arrival for _, block in pieces if not isnan(block.arrival)]
    samples, seq, time = sequence.follow(samples, known[-1] if known else nan, counts)
    hosts, origins, start = [], [], 0
    for count, block in pieces:
        hosts.append(times.follow(time[start : start + count], block.arrival, False))
        start += count
        origins.append((start, times.arrival, block.encoder))
    return pipeline.batches_of(samples, seq, time, np.concatenate(hosts), origins)


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
    samples = replace(pipeline.samples_of(whole), ends=ends)
    poses = pipeline.measurement.poses_of_pieces(samples)
    if poses is not None:
        yield pipeline.screen_poses(whole, samples, poses)
        return
    for part in halves(batches):
        yield from solve_together(pipeline, part)


def halves(parts: Sequence[Any]) -> tuple[Sequence[Any], Sequence[Any]]:
    return parts[: len(parts) // 2], parts[len(parts) // 2 :]
