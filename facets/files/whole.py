"""Write files completely or not at all, and check in advance that they can be written."""

from __future__ import annotations

import errno
import glob
import os
import secrets
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from types import FrameType, TracebackType
from typing import IO, Any

from ..core.errors import OutputError
from ..core.extras import require_extra
from ..core.names import escape_undecodable
from .completeness import require_complete

#: Optional modules that write files, by suffix.
WRITERS = {".h5": "h5py", ".mcap": "mcap.writer", ".parquet": "pyarrow"}
#: The name of the standard input, and of the standard output.
STANDARD_STREAM = Path("-")


def refuse_to_overwrite(
    paths: Sequence[Path], force: bool, sources: Sequence[Path | None] = ()
) -> None:
    """Check before the computation that all results can be written.

    sources: files that the results extend or derive from; None is skipped. Raises `OutputError` if
    a path is a source, exists without `force`, is a folder, or cannot be written; `InputError` if
    the extra that writes one of them is missing.
    """
    for path in paths:
        require_writable(path)
    existing = [path for path in paths if path != STANDARD_STREAM and path.exists()]
    read = [source for source in sources if source and source.exists()]
    for path in existing:
        if any(path.samefile(source) for source in read):
            raise OutputError(
                f"{path}: the result extends this file or is made from it; give the result "
                "another name"
            )
    if existing and not force:
        names, verb = ", ".join(map(str, existing)), "exist" + "s" * (len(existing) == 1)
        raise OutputError(f"{names}: {verb} already; use --force to overwrite")


def require_writable(path: Path) -> None:
    """Raise `OutputError` if a file of this name, or the standard output, cannot be written.

    A temporary file in the nearest existing folder is written and removed, because systems differ
    in how they report rights, read-only disks and full disks. Raises `InputError` if an extra is
    missing.
    """
    if path.suffix.lower() in WRITERS:
        require_extra(WRITERS[path.suffix.lower()], str(path))
    try:
        if path == STANDARD_STREAM:
            os.write(1, b"")
            return
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; name a file")
        folder = nearest_folder(path)
        with tempfile.TemporaryFile(dir=folder, prefix=".facets-") as file:
            file.write(bytes(4096))
    except OSError as error:
        raise cannot_write(path, error) from None


def nearest_folder(path: Path) -> Path:
    """Nearest existing folder above a path.

    Raises `OutputError` if this is a file, `OSError` if a name in the path is too long.
    """
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
    """Number of free bytes on the disk of a path."""
    return shutil.disk_usage(nearest_folder(path)).free


def cannot_write(path: Path, error: OSError) -> OutputError:
    text = str(path)
    shown = text if len(text) < 200 else f"{text[:80]} ... {text[-40:]}"
    return OutputError(f"{shown}: cannot be written: {reason_of(error)}")


def reason_of(error: OSError) -> str:
    """Reason of an error: the system's words, or the first line of a library's message."""
    return error.strerror or str(error).partition("\n")[0] or type(error).__name__


class Whole:
    """A file that appears under its name once it is complete, and not at all if writing fails.

    `with Whole(path) as temporary:` write to `temporary`, a path in the same folder. At the end the
    file is checked, because some libraries do not notice a full disk, and synced to the disk. Then
    it gets its name, so that neither an error nor a power failure leaves half a file. Within a
    `ResultSet` the file waits for the other files of the set.

    alone: whether the file belongs to no set, such as a cache for later runs.
    """

    def __init__(self, path: Path, alone: bool = False) -> None:
        self.path, self.alone = path, alone
        self.removes = False  # whether publishing the set removes the file of this name
        self.lock: IO[bytes] = BytesIO()  # the temporary file, locked while its process exists

    def __enter__(self) -> Path:
        self.folders = missing_folders(self.path.parent)
        self.temporary = hidden_name(self.path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            remove_orphans(self.path)
            handle = os.open(self.temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)
            self.lock = os.fdopen(handle, "wb")
            if not lock_file(self.lock):
                self.lock.close()  # Windows cannot rename an open file.
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
                    self.lock.close()
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
        """Path of a backup of the older file while a set is published."""
        return self.temporary.with_name(f"{self.temporary.name}.old")

    def restore(self) -> None:
        """Restore the older file of this name, or remove the new one if there was none."""
        if self.backup.exists():
            self.backup.replace(self.path)
        elif not (self.removes or self.temporary.exists()):
            self.path.unlink(missing_ok=True)

    def discard(self) -> None:
        """Remove the temporary file, the backup, and the folders that were made for them."""
        with hold_signals():
            self.lock.close()
            for path in (self.temporary, self.backup):
                with suppress(OSError):
                    path.unlink(missing_ok=True)
            for folder in self.folders:
                with suppress(OSError):
                    folder.rmdir()


def write_text(path: Path, text: str) -> None:
    """Write a text to a file, completely or not at all."""
    with Whole(path) as temporary:
        temporary.write_text(escape_undecodable(text), "utf-8")


class ResultSet:
    """The results of a command: files that appear under their names together or not at all.

    Within `with ResultSet():` every `Whole` waits until the end, when all files get their names.
    After an error, a full disk or ^C none of the files remains, nor any folder made for them, and
    the older files of these names are unchanged.
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
        """Add a complete file; it replaces an earlier one of the same name."""
        older = self.files.get(file.path)
        self.files[file.path] = file
        if older is not None:
            file.folders = older.folders
            older.folders = []
            older.discard()

    def publish(self) -> None:
        """Give all files their names; if that fails, restore all older files."""
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


#: The sets in progress, the innermost last.
_sets: list[ResultSet] = []


def readable_path(path: Path) -> Path:
    """Path at which a result can be read; within a `ResultSet`, of its temporary file."""
    written = next(
        (results.files[path] for results in reversed(_sets) if path in results.files), None
    )
    return path if written is None else written.temporary


def remove_older(path: Path) -> None:
    """Remove an older file; within a `ResultSet`, only when the set is published."""
    if not _sets:
        path.unlink(missing_ok=True)
        return
    removal = Whole(path)
    removal.folders, removal.temporary, removal.removes = [], hidden_name(path), True
    _sets[-1].add(removal)


def hidden_name(path: Path) -> Path:
    """An unused name for a hidden file in the folder of a path."""
    return path.with_name(f".{path.stem[:40]}-{secrets.token_hex(4)}{path.suffix}")


def remove_orphans(path: Path) -> None:
    """Remove hidden files of this result that no process locks, since their writers were killed."""
    name = glob.escape(f".{path.stem[:40]}-|{path.suffix}").replace("|", 8 * "[0-9a-f]")
    for hidden in path.parent.glob(name):
        with suppress(OSError), hidden.open("rb") as file:
            if lock_file(file):
                hidden.unlink()


def lock_file(file: IO[bytes]) -> bool:
    """Lock an open file until it is closed; return False if it is locked already, or the system has
    no locks."""
    try:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (ImportError, OSError):
        return False
    return True


def missing_folders(folder: Path) -> list[Path]:
    """Members of a folder's path that do not exist, itself included, the innermost first."""
    return [above for above in (folder, *folder.parents) if not above.exists()]


def link_or_copy(path: Path, backup: Path) -> None:
    """Back up a file by a hard link, or by a copy if the disk has no links."""
    try:
        os.link(path, backup)
    except OSError:
        shutil.copy2(path, backup)


@contextmanager
def hold_signals() -> Iterator[None]:
    """Context that delays signals, so that ^C does not interrupt moves of files."""
    waiting: list[tuple[int, FrameType | None]] = []
    handlers: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None and callable(signal.getsignal(number)):
                handlers[number] = signal.signal(number, lambda *args: waiting.append(args))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in waiting:
            handlers[number](number, frame)


def sync_to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk. Raises `OSError`."""
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if not path.is_dir() or error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise  # Some systems cannot sync folders.
    finally:
        os.close(handle)
