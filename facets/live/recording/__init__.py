"""A recording: the folder that a run writes, and that a replay reads."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import index as index, pose_table as pose_table, reader as reader, replay as replay
else:
    __getattr__ = load_on_use(__name__)
