"""What the public functions are given, checked in one place: numbers, and all else by annotations.

Python passes on whatever it is given, and NumPy makes numbers of text, of complex numbers, and of
what a mask or a table says is missing. So each public function is `checked`, and each array of
numbers comes in by `as_floats`.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from numbers import Integral, Real
from reprlib import Repr
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError
from .units import Floats

F = TypeVar("F", bound=Callable[..., Any])

FLOAT = np.dtype(np.float64)
#: Types of numbers that NumPy takes as they are.
PLAIN = {float, int, np.float64}
SEQUENCES = (tuple, Sequence)
SHORT = Repr()
SHORT.maxstring = SHORT.maxother = 40


class Numbers:
    """Stands for the annotations `ArrayLike` and `Floats`."""


class NotNumbersError(Exception):
    """Says of some values why they are no array of numbers: "has text in it ('1')"."""


def as_floats(values: ArrayLike, what: str) -> Floats:
    """Values as an array of floats; an array of floats as it is.

    What a NumPy mask hides, None inside a list or a table, and what pandas calls missing are NaN.
    Raises `InputError` for text, complex numbers, truth values, and rows of different lengths.
    """
    if type(values) is np.ndarray and values.dtype is FLOAT:
        return values
    try:
        if not is_one(Numbers, values):
            raise NotNumbersError(f"is {described(values)}")
        return floats_of(values)
    except NotNumbersError as fault:
        raise InputError(f"{what} {fault}; needed: numbers, all rows of one length") from None


def floats_of(values: Any) -> Floats:
    """`as_floats`; raises `NotNumbersError`."""
    if isinstance(values, list | tuple):
        return floats_of_list(values)
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "fiu":
        return np.asarray(np.ma.filled(values.astype(np.float64), np.nan))
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind == "O":
        return floats_of(values.tolist())  # None for what is masked
    try:
        array = np.asarray(values)
        if array.dtype.kind in "fiu":
            return array.astype(np.float64, copy=False)
        if array.dtype.kind == "O" and array.ndim == 0:
            return np.array(float(values))
        if array.dtype.kind == "O":
            return floats_of_list(array.ravel().tolist()).reshape(array.shape)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise NotNumbersError(f"has {described(values)} in it") from None
    kinds = {"c": "complex numbers", "b": "truth values", "U": "text", "S": "bytes"}
    kind = kinds.get(array.dtype.kind, f"values of the type {array.dtype}")
    raise NotNumbersError(f"has {kind} in it{f': {short(values)}' if array.ndim == 0 else ''}")


def floats_of_list(values: Sequence[Any]) -> Floats:
    if not is_plain(values):
        pandas = sys.modules.get("pandas")
        missing = None if pandas is None else pandas.NA
        values = [np.nan if one is None or one is missing else one for one in values]
    if not is_plain(values):
        values = [floats_of(value) for value in values]
    try:
        return np.array(values, dtype=np.float64)
    except ValueError:
        raise NotNumbersError("has rows of different lengths") from None
    except OverflowError:
        raise NotNumbersError("has a number in it that is too large") from None


def is_plain(values: Sequence[Any]) -> bool:
    """Whether NumPy makes of a list what stands in it: numbers, arrays of floats, lists of them."""
    types = set(map(type, values))
    if types <= PLAIN:
        return True
    if types == {np.ndarray}:
        return all(value.dtype is FLOAT for value in values)
    return types <= {list, tuple} and all(map(is_plain, values))


def checked(function: F) -> F:
    """Make a public function raise `InputError` for an argument that its annotation does not allow.

    The message says which argument, what it is, what is allowed, and where that is to be had. How
    large a number may be is for the function to say. A class has its arguments checked when an
    object is made. What was allowed before is looked up, since a live loop calls thousands of times
    a second.
    """
    if isinstance(function, type):
        function.__init__ = checked(function.__init__)  # type: ignore[misc]
        return function
    names = list(inspect.signature(function).parameters)
    allowed: dict[str, set[Any]] = {name: set() for name in names}
    allowed_together: set[tuple[type, ...]] = set()

    def check(name: str, value: Any) -> bool:
        """Whether all values of its type are allowed, as this one is."""
        hint = hints_of(function).get(name, Any)
        if not is_allowed(hint, value):
            raise InputError(refusal(name, hint, value))
        if isinstance(value, str) and has_words(hint):
            allowed[name].add(value)
        if isinstance(value, str) or any(get_origin(one) in SEQUENCES for one in options(hint)):
            return False
        allowed[name].add(type(value))
        return True

    @wraps(function)
    def call(*given: Any, **named: Any) -> Any:
        types = tuple(map(type, given))
        if types not in allowed_together:
            answers = [check(name, value) for name, value in zip(names, given, strict=False)]
            if all(answers):
                allowed_together.add(types)
        if not named:
            return function(*given)
        for name, value in named.items():
            known = allowed.get(name)
            key = value if type(value) is str else type(value)
            if known is not None and key not in known:
                check(name, value)
        return function(*given, **named)

    return call  # type: ignore[return-value]


@cache
def hints_of(function: Callable[..., Any]) -> dict[str, Any]:
    """The types of a function's arguments."""
    return get_type_hints(function, localns={"ArrayLike": Numbers, "Floats": Numbers})


def options(hint: Any) -> Iterable[Any]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def is_allowed(hint: Any, value: Any) -> bool:
    return any(is_one(option, value) for option in options(hint))


def is_one(option: Any, value: Any) -> bool:
    origin = get_origin(option)
    if option is Any:
        return True
    if origin is Literal:
        return isinstance(value, str) and value in get_args(option)
    if origin in SEQUENCES:
        kinds = [kind for kind in get_args(option) if kind is not ...]
        if not isinstance(value, list | tuple | np.ndarray):
            return False
        if origin is tuple and len(kinds) == len(get_args(option)) != len(value):
            return False
        return all(any(is_allowed(kind, item) for kind in kinds) for item in value)
    if origin is not None:
        return isinstance(value, origin)
    if option is int or option is float:
        number = Integral if option is int else Real
        return isinstance(value, number) and not isinstance(value, bool)
    if option is bool:
        return isinstance(value, bool | np.bool_)
    if option is Numbers:
        return not (value is None or isinstance(value, str | bytes | type) or is_dataclass(value))
    return isinstance(value, option)


def has_words(hint: Any) -> bool:
    return any(get_origin(option) is Literal for option in options(hint))


#: How an annotation is said.
WORDS = {
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    str: "text",
    Numbers: "numbers",
    NoneType: "None",
    np.random.Generator: "a random generator such as numpy.random.default_rng(1)",
}


def said(option: Any) -> str:
    """An annotation in words."""
    if get_origin(option) is Literal:
        return ", ".join(f'"{word}"' for word in get_args(option))
    if get_origin(option) in SEQUENCES:
        kinds = dict.fromkeys(kind for kind in get_args(option) if kind is not ...)
        fixed = get_origin(option) is tuple and ... not in get_args(option)
        count = f" of {len(get_args(option))}" if fixed else ""
        return f"a sequence{count}, each {' or '.join(map(said, kinds))}"
    if get_origin(option) is not None:
        return "a function"
    name = option.__name__
    return WORDS.get(option, f"{'an' if name[0] in 'AEIO' else 'a'} {name}")


def described(value: Any) -> str:
    """A value in an error: "a Config", "the class Sensor", "the str '2'"."""
    if value is None:
        return "None"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if is_dataclass(value):
        return f"a {type(value).__name__}"
    return f"the {type(value).__name__} {short(value)}"


def short(value: Any) -> str:
    """A value on one short line."""
    return " ".join(SHORT.repr(value).split())


def refusal(name: str, hint: Any, value: Any) -> str:
    """What is wrong with an argument, what is allowed, and what to do where that can be told."""
    if isinstance(value, str) and has_words(hint):
        text = f"{name} is {value!r}; allowed: "
    else:
        text = f"{name} is {described(value)}; allowed: "
    text += " or ".join(map(said, options(hint)))
    for option in options(hint):
        if is_dataclass(option) and (advice := remedy(option, value)):
            text += f"; pass {advice}"
    return text


def remedy(kind: Any, value: Any) -> str:
    """Where something of a kind is to be had from what was given instead of it; or ""."""
    if value is kind:
        return f"an object, as {kind.__name__}() makes it"
    if is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            if isinstance(getattr(value, field.name), kind):
                return f"{type(value).__name__.lower()}.{field.name}"
    if isinstance(value, str) and kind.__name__ in ("Sensor", "Config"):
        return f"facets.load({value!r}){'.sensor' if kind.__name__ == 'Sensor' else ''}"
    return ""
