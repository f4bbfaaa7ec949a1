"""Numbers as people write them, and lists of them by name: on command lines and in tables."""

from __future__ import annotations

from collections.abc import Sequence

from .errors import InputError


def plain_number(text: str) -> float:
    """The number that a text says. Raises `ValueError` where it says none; unlike `float`, also for
    digits apart (1_000) and for digits of other scripts."""
    if "_" in text or not text.isascii():
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)


def assignments(text: str, option: str, names: Sequence[str], form: str) -> dict[str, str]:
    """What `NAME=VALUE,NAME=VALUE` says of each name.

    option: whose text it is.  form: what is allowed. Raises `InputError` for other names, for a
    name that is given twice, and for nothing at all.
    """
    found: dict[str, str] = {}
    for part in text.split(","):
        name, _, value = (word.strip() for word in part.partition("="))
        if name not in names:
            raise InputError(
                f"{option} has {part.strip()!r}; allowed: {form}, of {', '.join(names)}"
            )
        if name in found:
            raise InputError(f"{option} has {name} twice; give it once")
        found[name] = value
    return found
