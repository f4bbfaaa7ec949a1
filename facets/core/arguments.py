"""Check the arguments of public functions: arrays by their values, others by their annotations.

Python accepts any argument, and NumPy converts text, complex numbers and masked or missing values
to numbers without an error. Therefore `check_arguments` decorates each public function, and
`as_floats` converts its arrays.
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
from .names import LABELS
from .notebook import show_shortly
from .units import Floats, describe_bounds, find_implausible

F = TypeVar("F", bound=Callable[..., Any])

FLOAT = np.dtype(np.float64)
#: Types of numbers that NumPy converts correctly.
PLAIN = {float, int, np.float64}
SEQUENCES = (tuple, Sequence)
SHORT = Repr()
SHORT.maxstring = SHORT.maxother = 40


class Numbers:
    """Placeholder for the annotations `ArrayLike` and `Floats`."""


class Frame:
    """Placeholder for the annotation `DataFrame` of pandas, which no check imports."""


#: Placeholders for annotations of arrays, and of types that are not imported.
PLACEHOLDERS = {"ArrayLike": Numbers, "Floats": Numbers, "DataFrame": Frame, "Dataset": Any}


class NotNumbersError(Exception):
    """Reason why values are no array of numbers, and the allowed form if not the usual one."""


def as_floats(values: ArrayLike, what: str, width: int = 0) -> Floats:
    """Convert values to an array of floats; an array of floats is returned unchanged.

    what: name of the values, for messages.  width: number of columns, by which `LABELS` has their
    names. Columns of a table, or of one of its rows, are then taken by name and converted to the
    code's units; with a width of 0 names are ignored. Values under a NumPy mask, None inside a list
    or a table, and pandas' missing values become NaN.
    Raises `InputError` for text, complex numbers, truth values, and rows of different lengths.
    """
    if type(values) is np.ndarray and values.dtype is FLOAT:
        return values
    try:
        if not may_be_numbers(values):
            raise NotNumbersError(f"is {describe_value(values)}")
        return floats_of(values, width)
    except NotNumbersError as error:
        fault, needed = (*error.args, "numbers, all rows of one length")[:2]
        raise InputError(f"{what} {fault}; needed: {needed}") from None


def index_of(values: Any) -> Any:
    """The index of a pandas data frame; None for other values."""
    return getattr(values, "index", None) if hasattr(values, "columns") else None


def require_plausible(values: Floats | float, name: str, what: str) -> None:
    """Raise `InputError` for numbers that are not plausible in the unit of a column's name.

    what: name of the numbers, for the message.
    """
    numbers = np.atleast_1d(values)
    wrong = numbers[find_implausible(numbers, name)]
    if len(wrong):
        raise InputError(f"{what} is {wrong[0]:g}; allowed: {describe_bounds(name)}")


def unmask(values: Any) -> Any:
    """The values of a masked array, where masked values become NaN or, in lists, None."""
    if values.dtype.kind in "fiu":
        return np.asarray(np.ma.filled(values.astype(np.float64), np.nan))
    return values.tolist() if values.dtype.kind == "O" else values


def labels_of(values: Any) -> list[Any]:
    """The names of the columns of a table or of one of its rows; empty if there are none."""
    dtype = getattr(values, "dtype", None)
    sources = ((dtype, "names"), (values, "column_names"), (values, "columns"), (values, "index"))
    candidates = (getattr(source, name, None) for source, name in sources)
    valid = (names for names in candidates if names is not None and not callable(names))
    labels = list(next(valid, ()))
    return labels if any(isinstance(label, str | tuple) for label in labels) else []


def pick_columns(values: Any, labels: list[Any], width: int) -> Floats:
    """Pick the columns of `LABELS` for a width by name, with or without units: (..., width).

    Raises `NotNumbersError` if a name is missing or occurs twice.
    """
    columns, units = LABELS[width]
    bare = [name.rpartition("_")[0] for name in columns]
    if all(labels.count(name) == 1 for name in bare):
        columns, units = tuple(bare), (1.0,) * width
    faults = [name for name in columns if labels.count(name) != 1]
    if faults:
        raise NotNumbersError(
            f"has names, but not once each: {', '.join(faults)}",
            f"the columns {', '.join(columns)}, or an array without names, such as x.to_numpy()",
        )
    return np.stack([floats_of(values[name]) for name in columns], axis=-1) * units


def floats_of(values: Any, width: int = 0) -> Floats:
    """Convert values as `as_floats` does, but raise `NotNumbersError`."""
    if width and (labels := labels_of(values)):
        return pick_columns(values, labels, width)
    if isinstance(values, np.ndarray) and hasattr(values, "mask"):  # numpy.ma is imported late
        values = unmask(values)
    if isinstance(values, list | tuple):
        return floats_of_list(values, width)
    try:
        array = np.asarray(values)
        if array.dtype.kind in "fiu":
            return array.astype(np.float64, copy=False)
        if array.dtype.kind == "O" and array.ndim == 0:
            return np.array(float(values))
        if array.dtype.kind == "O":
            return floats_of_list(array.ravel().tolist()).reshape(array.shape)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        raise NotNumbersError(f"has {describe_value(values)} in it") from None
    kinds = {"c": "complex numbers", "b": "truth values", "U": "text", "S": "bytes"}
    kind = kinds.get(array.dtype.kind, f"values of the type {array.dtype}")
    raise NotNumbersError(f"has {kind} in it{f': {shorten(values)}' if array.ndim == 0 else ''}")


def floats_of_list(values: Sequence[Any], width: int = 0) -> Floats:
    if not is_plain(values):
        pandas = sys.modules.get("pandas")
        missing = None if pandas is None else pandas.NA
        values = [np.nan if value is None or value is missing else value for value in values]
    if not is_plain(values):
        values = [floats_of(value, width) for value in values]
    try:
        return np.array(values, dtype=np.float64)
    except ValueError:
        raise NotNumbersError("has rows of different lengths") from None
    except OverflowError:
        raise NotNumbersError("has a number in it that is too large") from None


def is_plain(values: Sequence[Any]) -> bool:
    """Whether NumPy converts a list correctly, because it consists of numbers, of arrays of floats,
    or of such lists."""
    types = set(map(type, values))
    if types <= PLAIN:
        return True
    if types == {np.ndarray}:
        return all(value.dtype is FLOAT for value in values)
    return types <= {list, tuple} and all(map(is_plain, values))


def check_arguments(function: F) -> F:
    """Make a public function raise `InputError` for an argument that its annotation does not allow.

    The message states the argument's name and value, the allowed types, and where to get one. The
    function itself checks the size of numbers. For a class, the arguments of its constructor are
    checked; a dataclass also gets a short `repr`.
    """
    if isinstance(function, type):
        function.__init__ = check_arguments(function.__init__)  # type: ignore[misc]
        return show_shortly(function) if is_dataclass(function) else function
    check = ArgumentCheck(function)
    allowed_together = check.allowed_together

    @wraps(function)
    def call(*values: Any, **named: Any) -> Any:
        if tuple(map(type, values)) not in allowed_together:
            check.check_positional(values)
        if named:
            check.check_keywords(named)
        return function(*values, **named)

    return call  # type: ignore[return-value]


class ArgumentCheck:
    """Check of a function's arguments, which caches the allowed types, because a live loop calls a
    function thousands of times a second with the same types.

    allowed: by argument, types whose every value is allowed, and single words.  allowed_together:
    types of all positional arguments whose every value is allowed.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.names = list(inspect.signature(function).parameters)
        self.allowed: dict[str, set[Any]] = {name: set() for name in self.names}
        self.allowed_together: set[tuple[type, ...]] = set()

    def check_positional(self, values: tuple[Any, ...]) -> None:
        pairs = zip(self.names, values, strict=False)
        answers = [self.is_type_allowed(name, value) for name, value in pairs]
        if all(answers):
            self.allowed_together.add(tuple(map(type, values)))

    def check_keywords(self, named: dict[str, Any]) -> None:
        for name, value in named.items():
            allowed = self.allowed.get(name)
            key = value if type(value) is str else type(value)
            if allowed is not None and key not in allowed:
                self.is_type_allowed(name, value)

    def is_type_allowed(self, name: str, value: Any) -> bool:
        """Whether every value of this type is allowed; raise `InputError` if this value is not."""
        hint = hints_of(self.function).get(name, Any)
        if not is_allowed(hint, value):
            raise InputError(refusal(name, hint, value))
        if isinstance(value, str) and has_words(hint):
            self.allowed[name].add(value)
        if isinstance(value, str) or any(get_origin(kind) in SEQUENCES for kind in options(hint)):
            return False
        self.allowed[name].add(type(value))
        return True


@cache
def hints_of(function: Callable[..., Any]) -> dict[str, Any]:
    """The annotations of a function's arguments, by name."""
    return get_type_hints(function, localns=PLACEHOLDERS)


def options(hint: Any) -> Iterable[Any]:
    """The types that an annotation allows: the members of a union, or the only type."""
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def is_allowed(hint: Any, value: Any) -> bool:
    return any(has_type(value, option) for option in options(hint))


def has_type(value: Any, option: Any) -> bool:
    """Whether a value is of a type that is no union; truth values are no numbers."""
    origin = get_origin(option)
    if origin is Literal:
        return isinstance(value, str) and value in get_args(option)
    if origin in SEQUENCES:
        return is_sequence(value, option)
    if option in TESTS:
        return TESTS[option](value)
    return isinstance(value, origin or option)


def is_sequence(value: Any, option: Any) -> bool:
    """Whether a value is a list, tuple or array of the items that `option` allows."""
    if not isinstance(value, list | tuple | np.ndarray) or getattr(value, "shape", None) == ():
        return False
    kinds = [kind for kind in get_args(option) if kind is not ...]
    is_fixed = get_origin(option) is tuple and ... not in get_args(option)
    if is_fixed and len(kinds) != len(value):
        return False
    if float in kinds and set(map(type, value)) == {float}:  # fast for rows of a large covariance
        return True
    return all(any(is_allowed(kind, item) for kind in kinds) for item in value)


def is_number(value: Any, kind: type) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)


def may_be_numbers(value: Any) -> bool:
    """Whether NumPy might convert a value to numbers; `as_floats` decides."""
    return not (value is None or isinstance(value, str | bytes | type) or is_dataclass(value))


#: Tests of types that Python's own classes do not distinguish.
TESTS: dict[Any, Callable[[Any], bool]] = {
    Any: lambda value: True,
    int: lambda value: is_number(value, Integral),
    float: lambda value: is_number(value, Real),
    bool: lambda value: isinstance(value, bool | np.bool_),
    Numbers: may_be_numbers,
    Frame: lambda value: index_of(value) is not None,
}


def has_words(hint: Any) -> bool:
    return any(get_origin(option) is Literal for option in options(hint))


#: Names of types in messages.
WORDS = {
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    str: "text",
    Numbers: "numbers",
    Frame: "a data frame of pandas",
    NoneType: "None",
    np.random.Generator: "a random generator such as numpy.random.default_rng(1)",
}


def type_in_words(option: Any) -> str:
    """Describe a type in a message: "a sequence of 3, each a Psd"."""
    if get_origin(option) is Literal:
        return ", ".join(f'"{word}"' for word in get_args(option))
    if get_origin(option) in SEQUENCES:
        kinds = dict.fromkeys(kind for kind in get_args(option) if kind is not ...)
        fixed = get_origin(option) is tuple and ... not in get_args(option)
        count = f" of {len(get_args(option))}" if fixed else ""
        return f"a sequence{count}, each {' or '.join(map(type_in_words, kinds))}"
    if get_origin(option) is not None:
        return "a function"
    name = option.__name__
    return WORDS.get(option, f"{'an' if name[0] in 'AEIO' else 'a'} {name}")


def describe_value(value: Any) -> str:
    """Describe a value in a message: "a Config", "the class Sensor", "the str '2'"."""
    if value is None:
        return "None"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if is_dataclass(value):
        return f"a {type(value).__name__}"
    return f"the {type(value).__name__} {shorten(value)}"


def shorten(value: Any) -> str:
    """The `repr` of a value on one short line."""
    return " ".join(SHORT.repr(value).split())


def refusal(name: str, hint: Any, value: Any) -> str:
    """Write the message for a wrong argument: its value, the allowed types and, if known, what to
    pass instead."""
    if isinstance(value, str) and has_words(hint):
        text = f"{name} is {value!r}; allowed: "
    else:
        text = f"{name} is {describe_value(value)}; allowed: "
    text += " or ".join(map(type_in_words, options(hint)))
    for option in options(hint):
        if is_dataclass(option) and (advice := advice_on_value(option, value)):
            text += f"; pass {advice}"
    return text


def advice_on_value(kind: Any, value: Any) -> str:
    """Describe an object of a class that can replace a value; "" if none is known.

    It is an instance instead of the class, a field of the value, or the result of `facets.load`.
    """
    if value is kind:
        return f"an object, as {kind.__name__}() makes it"
    if is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            if isinstance(getattr(value, field.name), kind):
                return f"{type(value).__name__.lower()}.{field.name}"
    if isinstance(value, str) and kind.__name__ in ("Sensor", "Config"):
        return f"facets.load({value!r}){'.sensor' if kind.__name__ == 'Sensor' else ''}"
    return ""
