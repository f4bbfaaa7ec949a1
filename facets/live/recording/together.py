"""Many blocks followed and solved at once, as a replay can, to the same bits as one by one.

What one block costs beside its samples is many times the cost of the samples. The samples of blocks
are followed together where each is the next one of the sample before; their batches are solved
together where each is then counted as alone. Else both halves are tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import isnan, nan
from typing import Any, NamedTuple

import numpy as np

from ...tracking.encoder import Encoder
from ..run.doubts import LOOKED_AT
from ..run.pipeline import Batch, Pipeline, RunPoses, join, samples_of
from ..sources.frames import POSE, RawSamples
from ..sources.source import Block


class Parsed(NamedTuple):
    """The samples of a block, its arrival, s, and the stage's place then."""

    samples: RawSamples
    arrival: float
    encoder: Encoder | None


def solve_blocks(pipeline: Pipeline, blocks: Sequence[Block]) -> Iterator[RunPoses]:
    """Yield the poses of blocks as `Pipeline.feed` gives them, those of many blocks at once."""
    feed = pipeline.parser.feed
    parsed = (Parsed(feed(block.data), block.arrival, block.encoder) for block in blocks)
    yield from follow_blocks(pipeline, [block for block in parsed if len(block.samples)])


def follow_blocks(pipeline: Pipeline, blocks: Sequence[Parsed]) -> Iterator[RunPoses]:
    """Yield the poses of blocks with samples, followed together where they simply go on."""
    if len(blocks) < 2:
        batches = [batch for block in blocks for batch in pipeline.follow(*block)]
    elif not go_on(pipeline, samples := join([block.samples for block in blocks])):
        for part in halves(blocks):
            yield from follow_blocks(pipeline, part)
        return
    else:
        batches = follow_together(pipeline, samples, blocks)
    yield from solve_batches(pipeline, batches)


def go_on(pipeline: Pipeline, samples: RawSamples) -> bool:
    """Whether samples are nothing but the next ones of the newest."""
    return bool((samples.kind != POSE).all()) and pipeline.sequence.continues(samples)


def follow_together(
    pipeline: Pipeline, samples: RawSamples, blocks: Sequence[Parsed]
) -> list[Batch]:
    """Return what `Pipeline.follow` returns of each block, whose samples together go on."""
    counts = [len(block.samples) for block in blocks]
    known = [block.arrival for block in blocks if not isnan(block.arrival)]
    samples, seq, time = pipeline.sequence.follow(samples, known[-1] if known else nan, counts)
    hosts, origins, start = [], [], 0
    for count, block in zip(counts, blocks, strict=True):
        rows = slice(start, start + count)
        hosts.append(pipeline.times.follow(time[rows], block.arrival, False))
        origins.append((rows.stop, pipeline.times.arrival, block.encoder))
        start = rows.stop
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
    samples = replace(samples_of(pipeline.config, whole), ends=ends)
    poses = pipeline.measurement.poses_of_pieces(samples)
    if poses is not None:
        yield pipeline.screen_poses(whole, samples, poses)
        return
    for part in halves(batches):
        yield from solve_together(pipeline, part)


def halves(parts: Sequence[Any]) -> tuple[Sequence[Any], Sequence[Any]]:
    return parts[: len(parts) // 2], parts[len(parts) // 2 :]
