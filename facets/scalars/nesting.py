"""Numbers in nested tuples."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

#: Numbers of any kind in nested tuples.
Numbers = Any


def leaves(part: Numbers) -> Iterator[Any]:
    """Yield the numbers of nested tuples in order."""
    if isinstance(part, tuple):
        for inner in part:
            yield from leaves(inner)
    else:
        yield part


def nest(like: Numbers, numbers: Iterator[Any]) -> Numbers:
    """Nest numbers in tuples like those of `like`."""
    if not isinstance(like, tuple):
        return next(numbers)
    inner = [nest(each, numbers) for each in like]
    return type(like)(*inner) if hasattr(like, "_fields") else tuple(inner)
