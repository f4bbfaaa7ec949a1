"""Numbers, counts and names as text: on command lines, in messages and in tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .errors import InputError


def plain_number(text: str) -> float:
    """Convert text to a number; raise `ValueError` for text that is no number.

    Unlike `float` it refuses grouped digits (1_000) and the digits of other scripts.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"could not convert string to float: {text!r}")
    return float(text)


def short_number(value: float, digits: int = 3) -> str:
    """Write a number with some significant digits, and without an exponent below a million.

    Examples
    --------
    >>> short_number(1124.2, 2), short_number(0.5), short_number(21234.0)
    ('1,100', '0.5', '21,200')
    """
    text = f"{value:.{digits}g}"
    return f"{float(text):,.0f}" if "e+" in text and abs(value) < 1e6 else text


def count_text(number: int, noun: str) -> str:
    """Write a count with its noun, which takes an s in the plural: "1 sample", "2,000 samples"."""
    return f"{number:,} {noun}{'s' * (number != 1)}"


def times_text(number: int) -> str:
    """Write a number of times: "once", "twice", "3 times"."""
    return {1: "once", 2: "twice"}.get(number, f"{number:,} times")


def suggest_name(wrong: str, names: Iterable[str]) -> str:
    """Suggest the name nearest to a wrong one: "; did you mean 'paper'?"; "" if none is similar."""
    from difflib import get_close_matches

    nearest = get_close_matches(wrong, list(names), n=1, cutoff=0.55)
    return f"; did you mean {nearest[0]!r}?" if nearest else ""


def assignments(text: str, option: str, names: Sequence[str], form: str) -> dict[str, str]:
    """Read the value of each name from `NAME=VALUE,NAME=VALUE`.

    option: name of the option, for messages.  form: the allowed form, for messages. Raises
    `InputError` for other names, for a name that is given twice, and for empty text.
    """
    values: dict[str, str] = {}
    for part in text.split(","):
        name, _, value = (word.strip() for word in part.partition("="))
        if name not in names:
            raise InputError(
                f"{option} has {part.strip()!r}; allowed: {form}, of {', '.join(names)}"
                f"{suggest_name(name, names)}"
            )
        if name in values:
            raise InputError(f"{option} has {name} twice; give it once")
        values[name] = value
    return values
