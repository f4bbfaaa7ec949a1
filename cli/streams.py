"""Standard output and error, guarded while a command runs.

A command's results are its files. So a standard output that ends before the command does, as under
`| head -1`, or that is closed from the beginning (`>&-`), loses nothing: what is printed after that
is dropped, and the files are written. A standard output that cannot be written, as on a full disk,
is reported on standard error at the end.
"""

from __future__ import annotations

import codecs
import errno
import io
import os
import sys
from typing import IO, Any

from facets.core.names import escape_undecodable

#: Replacement of a character that an output's encoding lacks.
PLAIN = {"µ": "u", "±": "+-", "²": "^2", "·": "*", "\u00d7": "x", "\u2212": "-", "…": "..."}
#: The name of ASCII with these replacements; typer takes the name "ascii" for a mistake.
PLAIN_ASCII = "facets-ascii"


class Stream(io.RawIOBase):
    """A stream that never fails: text that cannot be written is dropped, and `error` says why."""

    def __init__(self, raw: IO[bytes]) -> None:
        self.raw = raw
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        if self.error is None:
            try:
                self.raw.write(data)
                self.raw.flush()
            except OSError as error:
                self.error = error
        return len(data)

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self.raw.fileno()

    def isatty(self) -> bool:
        return self.raw.isatty()


def open_closed_streams() -> None:
    """Open the null device for each standard stream that is closed, because the next file that is
    opened would take its number, and messages of libraries would be written into that file.

    Streams of output are opened for reading, so that writing to them fails as to a closed one.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDONLY if number else os.O_WRONLY)  # the lowest free number
            os.set_inheritable(number, True)
            if number:
                raw = io.FileIO(number, "w", closefd=False)
                setattr(sys, name, io.TextIOWrapper(io.BufferedWriter(raw), "utf-8"))


def guard(stream: Any) -> tuple[Any, Stream | None]:
    """Put `Stream` below a stream; return it unchanged if it is no file of the system."""
    try:
        stream.flush()
        low = Stream(open(stream.fileno(), "wb", buffering=0, closefd=False))  # noqa: SIM115
    except (OSError, ValueError, AttributeError):
        return stream, None
    uses_ascii = is_ascii(stream.encoding)
    text = io.TextIOWrapper(
        io.BufferedWriter(low),
        encoding=PLAIN_ASCII if uses_ascii else stream.encoding,
        errors="facets-plain",
        line_buffering=True,
    )
    return text, low


def is_ascii(encoding: str | None) -> bool:
    try:
        return codecs.lookup(encoding or "ascii").name == "ascii"
    except LookupError:
        return True


def replace_accents(error: UnicodeError) -> tuple[str, int]:
    """Error handler of `codecs`: replace characters that an encoding lacks."""
    assert isinstance(error, UnicodeEncodeError)
    lost = escape_undecodable(error.object[error.start : error.end])
    plain = [PLAIN.get(each, each if each.isascii() else "?") for each in lost]
    return "".join(plain), error.end


def plain_ascii(name: str) -> codecs.CodecInfo | None:
    """Search function of `codecs`: ASCII by another name."""
    if name.replace("-", "_") != PLAIN_ASCII.replace("-", "_"):
        return None
    codec = codecs.lookup("ascii")
    return codecs.CodecInfo(
        codec.encode, codec.decode, codec.streamreader, codec.streamwriter,
        codec.incrementalencoder, codec.incrementaldecoder, name=PLAIN_ASCII,
    )  # fmt: skip


codecs.register_error("facets-plain", replace_accents)
codecs.register(plain_ascii)


class Guarded:
    """Guarded standard output and error during a command; see `guard`."""

    def __enter__(self) -> Guarded:
        open_closed_streams()
        self.before = sys.stdout, sys.stderr
        sys.stdout, self.out = guard(sys.stdout)
        sys.stderr, _ = guard(sys.stderr)
        return self

    def __exit__(self, *_: object) -> None:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = self.before

    def failure(self) -> str:
        """Reason why the standard output could not be written; "" if there was no such failure."""
        sys.stdout.flush()
        error = None if self.out is None else self.out.error
        if error is None or error.errno in (errno.EPIPE, errno.EBADF):
            return ""
        return f"error: the standard output cannot be written: {error.strerror}"
