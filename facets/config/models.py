"""The checks of a configuration file, made from the declarations of its keys (`core.keys`).

The checks are strict: text and true/false are no numbers.
"""

from __future__ import annotations

from dataclasses import MISSING
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    create_model,
    model_validator,
)

from ..core.keys import Key, KeyBlock

NAME = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]


def list_to_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def single_to_pair(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else (value, value)


def none_to_block(value: Any) -> Any:
    """Return {} for a block in which all keys are commented out."""
    return {} if value is None else value


class StrictModel(BaseModel):
    """A block of keys; an empty block takes the defaults."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _empty_block(cls, data: Any) -> Any:
        return none_to_block(data)


def remove_defaults(schema: dict[str, Any]) -> None:
    for entry in schema["properties"].values():
        entry.pop("default", None)


class PartialModel(StrictModel):
    """A block whose missing keys take their values from another block, so that no defaults are
    shown."""

    model_config = ConfigDict(json_schema_extra=remove_defaults)


@cache
def model_of(block: KeyBlock, **constants: str) -> Any:
    """Make the check of a block of keys.

    constants: keys that must have one word, before all others.
    """
    entries: dict[str, Any] = {name: (Literal[word], ...) for name, word in constants.items()}
    entries |= {key.name: (type_of(key), field_of(key)) for key in block.keys}
    base = PartialModel if block.partial else StrictModel
    return create_model(block.name, __base__=base, __doc__=block.meaning, **entries)


def field_of(key: Key) -> Any:
    """The key's default and its meaning."""
    default: Any = ... if key.default is MISSING else key.default
    if key.block is not None:
        default = model_of(key.block)(**default)
    return Field(default, description=key.meaning)


def type_of(key: Key) -> Any:
    """The allowed type of a value in a file, with its bounds."""
    hint: Any
    if key.words is not None:
        return Literal[tuple(key.words)]
    if key.block is not None:
        return model_of(key.block)
    if key.named is not None:
        blocks: Any = dict[NAME, model_of(key.named)]  # type: ignore[misc]
        return Annotated[blocks, BeforeValidator(none_to_block)]
    if key.listed is not None:
        return Annotated[list[model_of(key.listed)], Field(**key.bounds)]  # type: ignore[misc]
    hint = bounded_type(key.hint, key)
    if key.from_single:
        single = get_args(get_args(hint)[0])[0]
        hint = Annotated[
            hint, BeforeValidator(single_to_pair, json_schema_input_type=single | hint)
        ]
    optional = key.default is None and NoneType not in get_args(key.hint)
    return hint | None if optional else hint


def bounded_type(hint: Any, key: Key) -> Any:
    """A field's type for pydantic, each number and text within the key's bounds."""
    kind, inner = get_origin(hint), get_args(hint)
    if kind in (Union, UnionType):
        return Union[tuple(bounded_type(part, key) for part in inner)]  # noqa: UP007
    if kind is tuple and ... in inner:
        length = Field(min_length=key.length, max_length=key.length)
        items: Any = list[bounded_type(inner[0], key)]  # type: ignore[misc]
        return Annotated[items, length]
    if kind is tuple:
        items = tuple[tuple(bounded_type(part, key) for part in inner)]  # type: ignore[misc]
        return Annotated[items, BeforeValidator(list_to_tuple)]
    plain: Any = str if hint is Path else hint
    if plain is str and key.check is not None:
        return Annotated[str, AfterValidator(key.check)]
    return Annotated[plain, Field(**key.bounds)] if plain in (float, int, str) else plain
