"""Declaration of configuration keys, each on the field that it sets.

The declaration states the key's default, bounds, unit and meaning. The default of the field, the
conversion to the units of the code, the check of files with its messages, and the JSON Schema
follow from it (`facets.config`).

    @dataclass(frozen=True)
    class Amplifier:
        "The amplifier of a detector's current."

        gain: float = key("gain_kohm", 100.0, "volts per ampere", gt=0, le=1e9)

The name's ending states the key's unit, kohm, and the field is in ohm:
`block_of(Amplifier).read({"gain_kohm": 5.0}).gain` is 5000.
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

    default: value in the key's unit; MISSING if a file must set the key.
    meaning: noun phrase for documentation and messages.
    unit: name of the unit in `KEY_UNITS`; "" for none.
    hint: type of the value in a file; None: type of the field.
    bounds: `gt`, `ge`, `lt`, `le` of each number; `pattern`, `min_length`, `max_length` of text,
    and the `error` for text that does not match the pattern.
    null: value of the field if the file has null.
    words: values of the field by the word in a file, for a field that holds no text.
    block: keys of the value, if this is a block.
    named: keys of each block inside the value, if the user names these blocks.
    kinds: as `named`, for blocks of several kinds, by the value of their key `kind`.
    listed: keys of each block in a list.
    length: of the list, for a field that holds a tuple of any length.
    from_single: whether a single number represents a pair of equal numbers.
    convert: function from the value in the code's units to the value of the field.
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
        """Convert a value in a file to the value of the field."""
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
        """Convert a field's numbers to the value in a file, the inverse of `read`."""
        return None if value == self.null else to_key(value, self.unit)


def to_code(value: Any, unit: str) -> Any:
    """Convert numbers from a key's unit to the code's; lists become tuples, other values remain
    unchanged."""
    if isinstance(value, list | tuple):
        return tuple(to_code(item, unit) for item in value)
    return KEY_UNITS[unit].to_code(value) if unit else value


def to_key(value: Any, unit: str) -> Any:
    """Convert numbers from the code's unit to a key's; tuples become lists, other values remain
    unchanged."""
    if isinstance(value, list | tuple):
        return [to_key(item, unit) for item in value]
    return KEY_UNITS[unit].to_key(value) if unit else value


@dataclass(frozen=True, eq=False)
class FieldSource:
    """The keys from which the value of a field follows.

    read: function from all values of the block to the field's value; None: the single key's value.
    index: index of the field's value in the single key's value; None: all of it.  write: function
    from the field's value to the values of the keys.
    """

    keys: tuple[Key, ...]
    read: Callable[[Values], Any] | None = None
    index: int | str | None = None
    write: Callable[[Any], Sequence[Any]] | None = None

    def value(self, values: Values) -> Any:
        """The field's value, from the values of the block's keys."""
        return self.read(values) if self.read else self.keys[0].read(values[self.keys[0].name])


def key(name: str, default: Any, meaning: str, **options: Any) -> Any:
    """Declare a field with its own key, whose unit is the ending of its name.

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
    """Declare a field of a dataclass whose value and default follow from keys."""
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

    sources: keys by field.  make: makes the object from the fields' values.  common: keys without a
    field, which apply to all blocks inside that do not override them.  partial: whether omitted
    keys take their values from another block, so that they have no default.
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
        keys = {key.name: key for source in self.sources.values() for key in source.keys}
        return [*self.common, *keys.values()]

    def read(self, values: Values) -> Any:
        """Make the object from the values of keys; an omitted key has its default."""
        values = {**{key.name: key.default for key in self.keys}, **values}
        return self.make(**{name: source.value(values) for name, source in self.sources.items()})

    def write(self, values: Values, target: Any) -> dict[str, Any]:
        """Return the values, with those changed whose field in the object `target` differs."""
        old, new = self.read(values), dict(values)
        for name, source in self.sources.items():
            value, first = getattr(target, name), source.keys[0]
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
            # Fields with several keys and no `write` come from files that other commands write.
            elif len(source.keys) == 1:
                new[first.name] = first.write(value)
        return new


@cache
def block_of(kind: type[Any]) -> KeyBlock:
    """The block of the keys that a dataclass declares; its meaning is the docstring's first
    paragraph."""
    hints = get_type_hints(kind)
    meaning = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
    sources = {
        member.name: complete(member.metadata["source"], hints[member.name])
        for member in fields(kind)
        if "source" in member.metadata
    }
    return KeyBlock(kind.__name__, meaning, sources, kind)


def complete(source: FieldSource, hint: Any) -> FieldSource:
    """Return a field's source with the field's type as the hint of its key."""
    if source.read is not None:
        return source
    single = source.keys[0]
    return replace(source, keys=(replace(single, hint=single.hint or hint),))


def block_of_keys(
    name: str, meaning: str, keys: Sequence[Key], make: Callable[..., Any]
) -> KeyBlock:
    """A block of keys, whose values `make` takes as keyword arguments."""
    return KeyBlock(name, meaning, {key.name: FieldSource((key,)) for key in keys}, make)


def drop_null(**values: Any) -> dict[str, Any]:
    """Return the arguments that are not None."""
    return {name: value for name, value in values.items() if value is not None}
