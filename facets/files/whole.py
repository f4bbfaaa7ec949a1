"""Files written whole or not at all, and places for them that are asked for before the work."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from ..core.errors import OutputError
from .completeness import require_complete


def refuse_to_overwrite(paths: Sequence[Path], force: bool) -> None:
    """Asks for the places of all results, before any work is done for them.

    Raises `OutputError` where one of the paths exists and is not to be replaced, is a folder, or
    can not be written.
    """
    for path in paths:
        require_writable(path)
    existing = [str(path) for path in paths if path.exists()]
    if existing and not force:
        raise OutputError(f"{', '.join(existing)}: exists already; --force replaces it")


def require_writable(path: Path) -> None:
    """Raises `OutputError` where a file of that name can not be written; leaves nothing behind.

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


def require_folder(path: Path) -> None:
    """Raises `OutputError` where a folder of that name can not be made, or written in."""
    require_writable(path / "results")


def nearest_folder(path: Path) -> Path:
    """The folder above a path that is there; each part of the path has a name that is allowed."""
    for above in path.parents:
        if above.exists():
            if not above.is_dir():
                raise OutputError(f"{above}: is a file; the results need a folder of another name")
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
    return OutputError(f"{shown}: can not be written: {reason_of(error)}")


def reason_of(error: OSError) -> str:
    """Why, in a line: the system's words, or the first of what a library said."""
    return error.strerror or str(error).partition("\n")[0] or type(error).__name__


class Whole:
    """A file that appears under its name when all is written, and not at all if that fails.

    `with Whole(path) as temporary:` write to `temporary`, a path in the same folder. At the end the
    file is looked over (some libraries do not notice a full disk), brought to the disk, and then
    given its name, so that neither an error nor a power failure leaves half of it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def __enter__(self) -> Path:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(
                dir=self.path.parent, prefix=f".{self.path.stem[:40]}-", suffix=self.path.suffix
            )
        except OSError as error:
            raise cannot_write(self.path, error) from None
        os.close(handle)
        umask = os.umask(0)
        os.umask(umask)
        self.temporary = Path(name)
        self.temporary.chmod(0o666 & ~umask)
        return self.temporary

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                require_complete(self.temporary)
                bring_to_disk(self.temporary)
                self.temporary.replace(self.path)
                bring_to_disk(self.path.parent)
                return
        except OSError as lost:
            raise cannot_write(self.path, lost) from None
        finally:
            with suppress(OSError):
                self.temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise cannot_write(self.path, error) from None


def bring_to_disk(path: Path) -> None:
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
