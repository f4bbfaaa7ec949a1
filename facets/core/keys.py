"""Declaration of configuration keys, each on the field that it sets.

The declaration states the key's default, bounds, unit and meaning. The default of the field, the
conversion to the units of the code, the check of files with its messages, and the JSON Schema
follow from it (`facets.config`).

    @dataclass(frozen=True)
    class Amplifier:
        "The amplifier of a detector's current."

        gain: float = key("gain_kohm", 100.0, "volts per ampere", gt=0, le=1e9)

By its name the key is in kohm: `block_of(Amplifier).read({"gain_kohm": 5.0}).gain` is 5000 ohm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cache
from typing import Any, get_type_hints

from .units import KEY_UNITS, unit_in

Values = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Key:
    """One key of a configuration.

    default: in the key's unit; MISSING where a file must give the key.
    hint: type of the value in a file; that of the field if None.
    bounds: `gt`, `ge`, `lt`, `le` of each number; `pattern`, `min_length`, `max_length` of text,
    `error` for text without the pattern.
    null: value of the field where the file has null.
    words: the field's value for each word of a file, for a field that holds no words.
    block: the keys inside, where the value is a block.
    named: the keys of each block inside, where the user gives these blocks their names.
    kinds: the same for blocks of several kinds, by the word that each has as its `kind`.
    listed: the keys of each block of a list.
    length: of a list for a field that holds a tuple of any length.
    from_single: whether a single number represents a pair of equal ones.
    convert: converts the value, in the units of the code, to that of the field.
    """

    name: str
    default: Any
    meaning: str
    unit: str = ""
    hint: Any = None
    bounds: Values = field(default_factory=dict)
    null: Any = None
    words: Values | None = None
    block: KeyBlock | None = None
    named: KeyBlock | None = None
    kinds: Mapping[str, KeyBlock] | None = None
    listed: KeyBlock | None = None
    length: int = 0
    from_single: bool = False
    convert: Callable[[Any], Any] | None = None

    def read(self, value: Any) -> Any:
        """The value of the field, from the value in a file."""
        if value is None:
            return self.null
        if self.words is not None:
            return self.words[value]
        if self.block is not None:
            value = self.block.read(value)
        elif self.named is not None:
            value = {name: self.named.read(values) for name, values in value.items()}
        elif self.listed is not None:
            value = tuple(self.listed.read(values) for values in value)
        else:
            value = to_code(value, self.unit)
        return value if self.convert is None else self.convert(value)

    def write(self, value: Any) -> Any:
        """The value in a file from that of the field: the inverse of `read`, for numbers and lists
        of them."""
        return None if value == self.null else to_key(value, self.unit)


def to_code(value: Any, unit: str) -> Any:
    """Convert numbers from a key's unit to that of the code; lists become tuples, other values
    stay."""
    if isinstance(value, list | tuple):
        return tuple(to_code(item, unit) for item in value)
    return KEY_UNITS[unit].to_code(value) if unit else value


def to_key(value: Any, unit: str) -> Any:
    """Convert numbers from the unit of the code to that of a key; tuples become lists, other values
    stay."""
    if isinstance(value, list | tuple):
        return [to_key(item, unit) for item in value]
    return KEY_UNITS[unit].to_key(value) if unit else value


@dataclass(frozen=True, eq=False)
class FieldSource:
    """The keys that give the value of one field.

    read: gives the field's value from all values of the block; None: the value of the only key.
    index: which item of the only key's value the field is, if not the whole. write: gives the
    values of the keys from that of the field.
    """

    keys: tuple[Key, ...]
    read: Callable[[Values], Any] | None = None
    index: int | str | None = None
    write: Callable[[Any], Sequence[Any]] | None = None

    def value(self, values: Values) -> Any:
        """The field's value."""
        return self.read(values) if self.read else self.keys[0].read(values[self.keys[0].name])


def key(name: str, default: Any, meaning: str, **options: Any) -> Any:
    """Declare a field with its own key, whose unit its name says.

    options: attributes of `Key`, and bounds.
    """
    attributes = {
        attribute: options.pop(attribute)
        for attribute in Key.__dataclass_fields__
        if attribute in options
    }
    attributes.setdefault("unit", unit_in(name))
    return declare(FieldSource((Key(name, default, meaning, bounds=options, **attributes),)))


def item_of(key: Key, index: int | str) -> Any:
    """Declare a field that holds one item of a key's value."""
    return declare(FieldSource((key,), lambda values: key.read(values[key.name])[index], index))


def declare(source: FieldSource) -> Any:
    """Declare a field of a dataclass whose value and default follow from several keys."""
    metadata = {"source": source}
    if any(part.default is MISSING for part in source.keys):
        return field(metadata=metadata)
    default = source.value({part.name: part.default for part in source.keys})
    if isinstance(default, dict):
        return field(default_factory=default.copy, metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, eq=False)
class KeyBlock:
    """A block of keys.

    sources: the keys of each field.  make: makes the object from the fields' values.  common: keys
    that only a file has, which hold for all blocks inside that do not override them.  partial:
    whether omitted keys have a value elsewhere, so that no default is shown.
    """

    name: str
    meaning: str
    sources: dict[str, FieldSource]
    make: Callable[..., Any]
    common: tuple[Key, ...] = ()
    partial: bool = False

    @property
    def keys(self) -> list[Key]:
        """All keys, in the order of a file."""
        of_fields = {key.name: key for source in self.sources.values() for key in source.keys}
        return [*self.common, *of_fields.values()]

    def read(self, values: Values) -> Any:
        """Convert the values of all keys; an omitted key has its default."""
        values = {**{key.name: key.default for key in self.keys}, **values}
        return self.make(**{name: source.value(values) for name, source in self.sources.items()})

    def write(self, values: Values, made: Any) -> dict[str, Any]:
        """Return the values, changed where a field of `made` differs from what they give."""
        old, new = self.read(values), dict(values)
        for name, source in self.sources.items():
            value, first = getattr(made, name), source.keys[0]
            if value == getattr(old, name):
                continue
            if first.block is not None:
                new[first.name] = first.block.write(new[first.name], value)
            elif isinstance(source.index, int):
                items = [*new[first.name]]
                items[source.index] = first.write(value)
                new[first.name] = items
            elif source.write is not None:
                pairs = zip(source.keys, source.write(value), strict=True)
                new |= {key.name: item for key, item in pairs}
            # A key without a default is filled in by a file that another command writes.
            elif len(source.keys) == 1:
                new[first.name] = first.write(value)
        return new


@cache
def block_of(kind: type[Any]) -> KeyBlock:
    """The keys that a dataclass declares; its docstring's first paragraph is their meaning."""
    hints = get_type_hints(kind)
    meaning = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
    sources = {
        member.name: complete(member.metadata["source"], hints[member.name])
        for member in fields(kind)
        if "source" in member.metadata
    }
    return KeyBlock(kind.__name__, meaning, sources, kind)


def complete(source: FieldSource, hint: Any) -> FieldSource:
    """The source of a field, whose key takes the field's type."""
    if source.read is not None:
        return source
    single = source.keys[0]
    return replace(source, keys=(replace(single, hint=single.hint or hint),))


def block_of_keys(
    name: str, meaning: str, keys: Sequence[Key], make: Callable[..., Any]
) -> KeyBlock:
    """A block of keys that `make` takes by name."""
    return KeyBlock(name, meaning, {key.name: FieldSource((key,)) for key in keys}, make)


def drop_null(**values: Any) -> dict[str, Any]:
    """Return the values of the keys that are not null, in the units of the code."""
    return {name: value for name, value in values.items() if value is not None}
