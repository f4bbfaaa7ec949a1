"""The JSON Schema of a configuration, made from the declarations of its keys (`core.keys`)."""

from __future__ import annotations

from dataclasses import MISSING
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from ..core.keys import Key, KeyBlock
from .keys import DOCUMENT

Node = dict[str, Any]
#: Names that the user gives to motions and parts.
NAME = "^[A-Za-z0-9][A-Za-z0-9._-]*$"
NULL = {"type": "null"}
#: An empty block takes the defaults.
BLOCK = ("object", "null")
TYPES = {float: "number", int: "integer", bool: "boolean", str: "string", Path: "string"}
LIMITS = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "lt": "exclusiveMaximum",
    "le": "maximum",
    "pattern": "pattern",
    "error": "patternErrorMessage",
    "min_length": "minLength",
    "max_length": "maxLength",
}


def _value_node(key: Key) -> Node:
    """The schema of a key's value that is not a block."""
    if key.words is not None:
        return _node_of_type(Literal[tuple(key.words)], key)
    node = _node_of_type(key.hint, key)
    if key.from_single:
        return {"anyOf": [node["prefixItems"][0], node]}
    if key.default is None and NoneType not in get_args(key.hint):
        return {"anyOf": [*node.get("anyOf", [node]), NULL]}
    return node


def _node_of_type(hint: Any, key: Key) -> Node:
    """The schema of a type, each number and text within the key's bounds."""
    kind, inner = get_origin(hint), get_args(hint)
    if kind in (Union, UnionType):
        return {"anyOf": [NULL if part is NoneType else _node_of_type(part, key) for part in inner]}
    if kind is Literal:
        return {"enum": list(inner), "type": "string"}
    if kind is list or ... in inner:
        return {"type": "array", "items": _node_of_type(inner[0], key), **_count(key.length)}
    if kind is tuple:
        items = [_node_of_type(part, key) for part in inner]
        return {"type": "array", "prefixItems": items, **_count(len(items))}
    return {LIMITS[word]: limit for word, limit in key.bounds.items()} | {"type": TYPES[hint]}


def _count(length: int) -> dict[str, int]:
    return {"minItems": length, "maxItems": length} if length else {}


@cache
def document() -> Node:
    """The schema of a configuration, with the schemas of its blocks under `$defs`."""
    definitions: dict[str, Node] = {}
    body = block_node(DOCUMENT, definitions)
    return {**body, "$defs": dict(sorted(definitions.items()))}


def block_node(block: KeyBlock, definitions: dict[str, Node]) -> Node:
    """The schema of a block of keys.

    definitions: receives the schemas of the blocks inside. A partial block, whose omitted keys take
    their values from another block, has neither defaults nor `required`.
    """
    properties = {key.name: _key_node(key, definitions) for key in block.keys}
    required = {"required": [key.name for key in block.keys if key.default is MISSING]}
    if block.partial:
        required = {}
        for node in properties.values():
            node.pop("default", None)
    return {
        "title": block.name,
        "description": block.meaning,
        "type": BLOCK,
        "properties": properties,
        "additionalProperties": False,
        **required,
    }


def _key_node(key: Key, definitions: dict[str, Node]) -> Node:
    def refer(block: KeyBlock) -> Node:
        if block.name not in definitions:
            definitions[block.name] = block_node(block, definitions)
        return {"$ref": f"#/$defs/{block.name}"}

    if key.block is not None:
        node = refer(key.block)
    elif key.named is not None:
        node = {"type": BLOCK, "patternProperties": {NAME: refer(key.named)}}
    elif key.kinds is not None:
        options = {"anyOf": [refer(block) for block in key.kinds.values()]}
        node = {"type": BLOCK, "patternProperties": {NAME: options}}
    elif key.listed is not None:
        node = {"type": "array", "items": refer(key.listed), "maxItems": key.bounds["max_length"]}
    else:
        node = _value_node(key)
    default = {} if key.default is MISSING else {"default": key.default}
    return {**node, "description": key.meaning, **default}
