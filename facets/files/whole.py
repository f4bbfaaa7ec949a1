"""Files written whole or not at all, and places for them that are asked for before the work."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from ..core.errors import OutputError
from .completeness import require_complete


def refuse_to_overwrite(paths: Sequence[Path], force: bool) -> None:
    """Asks for the places of all results, before any work is done for them.

    Raises `OutputError` where one of the paths exists and is not to be replaced, is a folder, or
    cannot be written.
    """
    for path in paths:
        require_writable(path)
    existing = [str(path) for path in paths if path.exists()]
    if existing and not force:
        raise OutputError(f"{', '.join(existing)}: exists already; use --force to replace it")


def require_writable(path: Path) -> None:
    """Raises `OutputError` where a file of that name cannot be written; leaves nothing behind.

    Tries it, in the folder that is there already: rights, a read-only disk and a full one differ
    from system to system.
    """
    try:
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; name a file")
        folder = nearest_folder(path)
        with tempfile.TemporaryFile(dir=folder, prefix=".facets-") as file:
            file.write(bytes(4096))
    except OSError as error:
        raise cannot_write(path, error) from None


def nearest_folder(path: Path) -> Path:
    """The folder above a path that is there; each part of the path has a name that is allowed."""
    for above in path.parents:
        if above.exists():
            if not above.is_dir():
                raise OutputError(f"{above}: is a file; name another folder for the results")
            limit = os.pathconf(above, "PC_NAME_MAX") if hasattr(os, "pathconf") else 255
            for part in path.relative_to(above).parts:
                if len(os.fsencode(part)) > limit:
                    raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
            return above
    return Path()


def free_space(path: Path) -> int:
    """Bytes that are free on the disk that a file of that name would stand on."""
    return shutil.disk_usage(nearest_folder(path)).free


def cannot_write(path: Path, error: OSError) -> OutputError:
    text = str(path)
    shown = text if len(text) < 200 else f"{text[:80]} ... {text[-40:]}"
    return OutputError(f"{shown}: cannot be written: {reason_of(error)}")


def reason_of(error: OSError) -> str:
    """Why, in a line: the system's words, or the first of what a library said."""
    return error.strerror or str(error).partition("\n")[0] or type(error).__name__


class Whole:
    """A file that appears under its name when all is written, and not at all if that fails.

    `with Whole(path) as temporary:` write to `temporary`, a path in the same folder. At the end the
    file is looked over (some libraries do not notice a full disk), brought to the disk, and then
    given its name, so that neither an error nor a power failure leaves half of it. Within a
    `ResultSet` it waits for the other files of the set.

    alone: whether it belongs to no set, as what is kept for later runs.
    """

    def __init__(self, path: Path, alone: bool = False) -> None:
        self.path, self.alone = path, alone
        self.removes = False  # a set also takes older files away

    def __enter__(self) -> Path:
        self.folders = missing_folders(self.path.parent)
        self.temporary = hidden_name(self.path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            os.close(os.open(self.temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except BaseException as error:
            self.discard()
            if isinstance(error, OSError):
                raise cannot_write(self.path, error) from None
            raise
        return self.temporary

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                require_complete(self.temporary)
                sync_to_disk(self.temporary)
                if _sets and not self.alone:
                    _sets[-1].add(self)
                else:
                    self.temporary.replace(self.path)
                    sync_to_disk(self.path.parent)
                return
        except BaseException as lost:
            self.discard()
            if isinstance(lost, OSError):
                raise cannot_write(self.path, lost) from None
            raise
        self.discard()
        if isinstance(error, OSError):
            raise cannot_write(self.path, error) from None

    @property
    def backup(self) -> Path:
        """Where the older file of that name waits while a set is published."""
        return self.temporary.with_name(f"{self.temporary.name}.old")

    def restore(self) -> None:
        """Puts the older file of that name back; without one there is none again."""
        if self.backup.exists():
            self.backup.replace(self.path)
        elif not (self.removes or self.temporary.exists()):
            self.path.unlink(missing_ok=True)

    def discard(self) -> None:
        """Takes away what was written so far, and the folders that were made for it."""
        with hold_signals():
            for path in (self.temporary, self.backup):
                with suppress(OSError):
                    path.unlink(missing_ok=True)
            for folder in self.folders:
                with suppress(OSError):
                    folder.rmdir()


class ResultSet:
    """The results of a command: files that appear under their names together, or none of them.

    `with ResultSet():` every `Whole` in it waits until the end, when all of them are given their
    names. After an error, a full disk or ^C there is none of them, nor a folder that was made for
    them, and the older files of these names are as they were.
    """

    def __init__(self) -> None:
        self.files: dict[Path, Whole] = {}

    def __enter__(self) -> ResultSet:
        _sets.append(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        _sets.remove(self)
        try:
            if kind is None:
                with hold_signals():
                    self.publish()
        except OSError as lost:
            raise cannot_write(Path(lost.filename or next(iter(self.files))), lost) from None
        finally:
            for file in reversed(self.files.values()):
                file.discard()

    def add(self, file: Whole) -> None:
        """Takes a file that is written; an earlier one of the same name goes."""
        older = self.files.get(file.path)
        self.files[file.path] = file
        if older is not None:
            file.folders = older.folders
            older.folders = []
            older.discard()

    def publish(self) -> None:
        """Gives all files their names; where that fails, all older files are put back."""
        files = self.files.values()
        try:
            for file in files:
                if file.path.exists():
                    link_or_copy(file.path, file.backup)
            for file in files:
                if file.removes:
                    file.path.unlink(missing_ok=True)
                else:
                    file.temporary.replace(file.path)
            for folder in {file.path.parent for file in files}:
                sync_to_disk(folder)
        except BaseException:
            for file in files:
                file.restore()
            raise


#: The sets that are being written, the innermost last.
_sets: list[ResultSet] = []


def readable_path(path: Path) -> Path:
    """Where the file of that name can be read: within a `ResultSet` it has no name of its own
    yet."""
    found = next((one.files[path] for one in reversed(_sets) if path in one.files), None)
    return path if found is None else found.temporary


def remove_older(path: Path) -> None:
    """Takes an older file away; within a `ResultSet`, with the others of the set."""
    if not _sets:
        path.unlink(missing_ok=True)
        return
    nothing = Whole(path)
    nothing.folders, nothing.temporary, nothing.removes = [], hidden_name(path), True
    _sets[-1].add(nothing)


def hidden_name(path: Path) -> Path:
    """A name that no other file has, beside that one."""
    return path.with_name(f".{path.stem[:40]}-{secrets.token_hex(4)}{path.suffix}")


def missing_folders(folder: Path) -> list[Path]:
    """The folder and those above that are not there, the innermost first."""
    return [one for one in (folder, *folder.parents) if not one.exists()]


def link_or_copy(path: Path, backup: Path) -> None:
    """A second name for a file; where a disk knows none, a copy."""
    try:
        os.link(path, backup)
    except OSError:
        shutil.copy2(path, backup)


@contextmanager
def hold_signals() -> Iterator[None]:
    """Within it signals wait, so that ^C does not come between moves of files."""
    waiting: list[tuple[int, FrameType | None]] = []
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None and callable(signal.getsignal(number)):
                before[number] = signal.signal(number, lambda *args: waiting.append(args))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number, frame in waiting:
            before[number](number, frame)


def sync_to_disk(path: Path) -> None:
    """Waits until a file, or the names in a folder, are on the disk. Raises `OSError`."""
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if not path.is_dir() or error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise  # some systems have no folders that can be synced
    finally:
        os.close(handle)
