"""The result files of a command: checked before the work, written together, named at the end."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from facets import files

if TYPE_CHECKING:
    from facets.config import Config


class ResultFolder:
    """The results of a command in a folder, whose places are checked at once, before any work.

    names: names of the files in the folder.  sources: files that must not be overwritten.  others:
    files in other places, which are checked, too.
    """

    def __init__(
        self,
        folder: Path,
        names: Sequence[str],
        force: bool,
        sources: Sequence[Path | None] = (),
        others: Sequence[Path] = (),
    ) -> None:
        self.start = time.perf_counter()
        self.folder, self.paths = folder, [folder / name for name in names]
        files.whole.refuse_to_overwrite([*self.paths, *others], force, sources)

    @property
    def seconds(self) -> float:
        """Duration of the command's work until now."""
        return time.perf_counter() - self.start

    @contextmanager
    def publish(
        self, settings: Config, seed: int | None = None, more: Mapping[str, str] | None = None
    ) -> Iterator[list[Path]]:
        """Context in which the files are written; they get their names together at its end.

        Yields their paths.  more: entries for the heads of the tables besides the provenance.
        """
        self.settings, self.seed = settings, seed
        self.about = files.provenance.provenance_header(settings, seed) | dict(more or {})
        with files.whole.ResultSet():
            yield self.paths

    def write_table(self, path: Path, columns: Mapping[str, Any]) -> None:
        entry = files.provenance.configuration_entry(self.settings)
        files.tables.write_table(path, columns, self.about | entry)

    def write_record(self, entries: dict[str, Any], seed: int | None = None) -> None:
        """Write the record of the run, with its duration, and the description of the folder."""
        seed = self.seed if seed is None else seed
        seconds = self.seconds
        record = files.provenance.run_record(self.settings, seed, seconds, entries)
        files.whole.write_text(self.folder / "run.yaml", record)
        about = files.provenance.provenance_header(self.settings, seed)
        files.write_crate(self.folder, self.paths, about, seconds)

    def name(self) -> None:
        """Print the last line of a command, which lists the files that it wrote."""
        name_files(self.folder, self.paths)


def name_files(folder: Path, paths: Sequence[Path]) -> None:
    """Print the files of a folder that exist."""
    print(f"{folder}/: {', '.join(file.name for file in paths if file.exists())}")
