"""Objects that are closed at the end of a `with` statement."""

from __future__ import annotations

from typing import Self


class ClosedAtExit:
    """Base of objects that a `with` statement closes at its end."""

    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
