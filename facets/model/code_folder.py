"""The folder of compiled machine code, whose name is a hash of the source text of the code."""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
import threading
from collections.abc import Iterator
from multiprocessing import parent_process
from pathlib import Path

import platformdirs

HERE = Path(__file__).parent
#: Folders whose files are the source of all machine code.
TEXT = (HERE.parent / "optics", HERE.parent / "scalars")


def text_of(files: tuple[Path, ...]) -> Iterator[Path]:
    """Yield the source files of which the machine code is made."""
    for folder in TEXT:
        yield from sorted(folder.glob("*.py"))
    yield from files


def code_folder(maker: str, *files: str | Path | None) -> tuple[Path, object]:
    """Return the folder of the machine code made from these files and the optics, and the temporary
    folder that owns it.

    maker: name and version of the compiler. The folder is in the user's cache or, if that cannot be
    written, a temporary one of this process.
    """
    text = hashlib.sha256(maker.encode())
    for file in text_of(tuple(Path(file) for file in files if file)):
        text.update(file.read_bytes())
    name = text.hexdigest()[:16]
    base = os.environ.get("FACETS_CACHE_DIR") or platformdirs.user_cache_dir("facets-6dof")
    folder = Path(base) / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder, None
    except OSError:
        passing = tempfile.TemporaryDirectory(prefix="facets-")
        return Path(passing.name), passing


_LOG_LOCK = threading.Lock()
_is_logged = False


def log_compilation(passing: object) -> None:
    """Log once per process that code is compiled; without a handler, on the standard error.

    passing: from `code_folder`. A worker of `multiprocessing` logs nothing; its parent does.
    """
    global _is_logged
    with _LOG_LOCK:
        if _is_logged or parent_process() is not None:
            return
        _is_logged = True
    later = "later runs are faster" if passing is None else "in every run: no cache can be written"
    text = f"facets: compiling what this command needs (some seconds; {later}) ..."
    logging.getLogger("facets").warning(text)
