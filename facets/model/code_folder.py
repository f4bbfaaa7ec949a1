"""Where machine code is kept: in a folder that is named after the text it is made of."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from multiprocessing import parent_process
from pathlib import Path

import platformdirs

HERE = Path(__file__).parent
#: Folders of text that all machine code is made of.
TEXT = (HERE.parent / "optics", HERE.parent / "scalars")


def text_of(files: tuple[Path, ...]) -> Iterator[Path]:
    for folder in TEXT:
        yield from sorted(folder.glob("*.py"))
    yield from files


def code_folder(maker: str, *files: str | Path | None) -> tuple[Path, object]:
    """Where the machine code made of these files and of the optics is kept.

    maker: what makes it, and in which version.  The user's cache, else a folder that goes with this
    process. The second is what keeps that folder.
    """
    text = hashlib.sha256(maker.encode())
    for file in text_of(tuple(Path(file) for file in files if file)):
        text.update(file.read_bytes())
    name = text.hexdigest()[:16]
    base = os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("facets-6dof")
    folder = Path(base) / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder, None
    except OSError:
        passing = tempfile.TemporaryDirectory(prefix="facets-")
        return Path(passing.name), passing


_TELLING = threading.Lock()
_told = False


def tell(passing: object) -> None:
    """Says on the standard error, once a process, that code has to be compiled.

    passing: what `code_folder` gives.  A worker of `multiprocessing` leaves it to its parent.
    """
    global _told
    with _TELLING:
        if _told or parent_process() is not None:
            return
        _told = True
    when = "only the first time" if passing is None else "each time: no cache can be written"
    print(f"facets: compiling for this processor (some seconds, {when}) ...", file=sys.stderr)
