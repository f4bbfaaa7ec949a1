"""Solve a recording again, write its poses to files, and compare them with the recorded ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.channels import describe_channels
from ..core.errors import InputError
from ..estimation.solution import worded_columns
from ..estimation.zero import PoseColumns, ZeroRequest
from ..files import provenance, tables
from ..files.whole import STANDARD_STREAM
from .recording.comparison import PoseComparison, comparison_sentences
from .recording.index import Damage
from .recording.pose_table import recorded_parts
from .recording.reader import meta_of, seal_of, utc_offset
from .recording.replay import recorded_config, replay
from .run.pipeline import Pipeline, RunPoses, join_poses
from .streams.mcap_file import McapFile
from .streams.sample_rows import row_content

if TYPE_CHECKING:
    from ..core.settings import Config

#: Number of samples that are written to a file together, because each write has a fixed cost and a
#: recording's blocks have few samples. Standard output gets each block at once.
ROWS_PER_WRITE = 5_000


class Playback:
    """A recording that is solved again from its bytes.

    Parameters
    ----------
    folder : Path
        The recording.
    config : Config, optional
        The configuration for solving; the recording's own by default.
    change : callable, optional
        Returns the configuration with changes, such as another point of the object.
    columns : PoseColumns, optional
        Further columns of the poses, such as displacements from a zero.

    Raises
    ------
    InputError
        If the folder is no recording, or its configuration is damaged or was changed.

    Examples
    --------
    >>> from pathlib import Path
    >>> from facets.live import Playback
    >>> playback = Playback(Path("recordings/today"))  # doctest: +SKIP
    >>> poses = list(playback.poses())  # doctest: +SKIP
    >>> print(*playback.sentences(), sep="\\n")  # doctest: +SKIP
    recordings/today: 24534 samples, 0 lost, 0 frames refused, 0 bytes passed over
    """

    def __init__(
        self,
        folder: Path,
        config: Config | None = None,
        *,
        change: Callable[[Config], Config] = lambda config: config,
        columns: PoseColumns | None = None,
    ) -> None:
        meta = meta_of(folder, sealed=config is None)
        self.folder, self.recorded = folder, str(meta.get("made", ""))
        self.config = change(config or recorded_config(folder))
        self.pipeline, self.damage = Pipeline(self.config, columns), Damage()

    def poses(
        self,
        recover: bool = False,
        on_progress: Callable[[int, int], None] = lambda done, of: None,
    ) -> Iterator[RunPoses]:
        """Yield the poses, in the blocks of the recorded bytes.

        recover: also read bytes without an index, or with one that does not match, which otherwise
        raise `InputError`.  on_progress: called with the number of bytes read and their total.
        """
        return replay(self.folder, self.pipeline, self.damage, on_progress, recover)

    def finish(
        self,
        poses: Iterable[RunPoses],
        path: Path | None,
        compare: bool,
        config_name: str | None,
    ) -> tuple[list[str], bool]:
        """Solve all samples, write the poses to `path`, if any, and compare them on request.

        config_name: name of the configuration for solving, unless it is the recording's own.
        Returns the sentences for the user, and whether no comparison found a difference.
        """
        comparison = PoseComparison(recorded_parts(self.folder))
        if compare:
            poses = comparison.following(poses)
        if path:
            self.write(path, poses)
        deque(poses, maxlen=0)  # solve all poses, even if no output uses them
        sentences = list(self.sentences())
        if not compare:
            return sentences, True
        version = meta_of(self.folder, sealed=False).get("facets")
        compared, is_same = comparison_sentences(
            comparison, seal_of(self.folder), self.damage, self.folder, version, config_name
        )
        return [*sentences, *compared], is_same

    def sentences(self) -> Iterator[str]:
        """Yield the number of solved samples, and the faults of the recording."""
        sequence, tally, parser = self.pipeline.sequence, self.pipeline.tally, self.pipeline.parser
        yield (
            f"{self.folder}: {tally.samples} samples, {sequence.lost} lost, "
            f"{parser.corrupt} frames refused, {parser.skipped} bytes passed over"
        )
        if self.damage.words:
            yield f"  damaged: {self.damage.words}"
        board, sentences = self.pipeline.board, self.pipeline.measurement.sentences()
        clock = (*sequence.sentences(), *self.pipeline.times.messages)
        for text in (
            *tally.status_sentences(),
            *clock,
            *sentences,
            board.sentence(),
            board.trouble(),
        ):
            if text:
                yield f"  {text}"

    def write(self, path: Path, poses: Iterable[RunPoses]) -> None:
        """Write poses to a table or an MCAP file.

        Raises `InputError` if there are no samples.
        """
        about = provenance.provenance_header(self.config)
        about |= provenance.configuration_entry(self.config)
        about |= describe_channels(self.config.acquire.channels) | {"recorded": self.recorded}
        poses, measurement = self.await_zero(poses), self.pipeline.measurement
        if measurement.zero is not None:
            about["zero"] = measurement.zero_text
        content = row_content(self.config, measurement)
        if is_mcap(path):
            offset = utc_offset(self.folder) or 0.0
            with (
                tables.Whole(path) as temporary,
                McapFile(temporary, about, offset, content) as file,
            ):
                for part in poses:
                    file.write(part)
        else:
            self.write_table(path, poses, about)

    def await_zero(self, poses: Iterable[RunPoses]) -> Iterator[RunPoses]:
        """Return the same poses once the zero of displacements is measured.

        Raises `InputError` if the recording ends before.
        """
        held, rest = [], iter(poses)
        while self.pipeline.measurement.is_measuring:
            part = next(rest, None)
            if part is None:
                raise InputError(f"{self.folder}: {self.pipeline.measurement.zero_sentences()[0]}")
            held.append(part)
        return chain(held, rest)

    def write_table(self, path: Path, poses: Iterable[RunPoses], about: dict[str, str]) -> None:
        """Write the table of poses. Raises `InputError` if there are none."""
        parts = poses if path == STANDARD_STREAM else gather_poses(poses)
        with tables.open_writer(path, about) as writer:
            for part in parts:
                writer.write(worded_columns(part.columns()))
            if not writer.file:
                raise InputError(
                    f"{path}: was not written, because the recording holds no complete sample"
                )


def gather_poses(parts: Iterable[RunPoses]) -> Iterator[RunPoses]:
    """Yield the same poses in parts of at least `ROWS_PER_WRITE` samples, but for the last part."""
    held, count = list[RunPoses](), 0
    for part in parts:
        held.append(part)
        count += len(part)
        if count >= ROWS_PER_WRITE:
            yield join_poses(held)
            held, count = [], 0
    if held:
        yield join_poses(held)


def is_mcap(path: Path | None) -> bool:
    """Whether a path names an MCAP file."""
    return path is not None and path.suffix.lower() == ".mcap"


def refuse_output(path: Path | None, force: bool, zero: ZeroRequest | None) -> None:
    """Raise `InputError` for an output that cannot be written."""
    if path is None:
        return
    if not is_mcap(path):
        tables.ending(path)
    tables.refuse_to_overwrite([path], force, [zero.file if zero else None])
