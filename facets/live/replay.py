"""A recording through the same parser and solver again, or saved from where it was cut off."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..estimation.solver import Status
from .pipeline import Pipeline, Poses
from .recording import blocks, kept, meta_of, pose_columns

if TYPE_CHECKING:
    from ..core.settings import Config


def recorded_config(folder: Path) -> Config:
    """The configuration that a recording was made with, as it keeps it."""
    import tempfile

    from ruamel.yaml import YAML

    from ..config.loading import load, measured

    meta = meta_of(folder)
    for keys, name, total in measured(meta["resolved"]):
        keys[name] = str((folder / kept(total)).resolve())
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / f"{meta['config']}.yaml"
        with path.open("w", encoding="utf-8") as file:
            YAML(typ="safe").dump(meta["resolved"], file)
        return load(path)


def replayed(folder: Path, pipeline: Pipeline, real_time: bool = False) -> Iterator[Poses]:
    """The poses of a recording, block by block as they came; equal to those of the run."""
    begin: tuple[float, float] | None = None
    for block in blocks(folder):
        if real_time:
            begin = begin or (time.monotonic(), block.arrival)
            time.sleep(max(0.0, begin[0] + block.arrival - begin[1] - time.monotonic()))
        poses = pipeline.feed(block.data, block.arrival, block.encoder)
        if poses is not None:
            yield poses


def labelled(poses: Poses) -> dict[str, Any]:
    """The columns of `recording.pose_columns`, the status in words."""
    names = np.array([status.label for status in Status])
    columns = pose_columns(poses)
    return columns | {"status": names[columns["status"]]}
