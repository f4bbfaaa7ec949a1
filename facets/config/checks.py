"""Check a configuration by its JSON Schema, strictly: text and true/false are not numbers."""

from __future__ import annotations

import re
from collections.abc import Callable
from copy import deepcopy
from math import inf
from operator import ge, gt, le, lt
from typing import Any

from ..core.names import DETECTORS
from .json_schema import entry_below, follow_reference
from .nodes import BLOCK, NAME, NULL, Node, document
from .problems import missing_key, unknown_key, wrong_name, wrong_value
from .yaml_positions import Path_

TYPES: dict[Any, tuple[type, ...]] = {
    "number": (float, int),
    "integer": (int,),
    "boolean": (bool,),
    "string": (str,),
    "array": (list, tuple),
}


#: Limits of numbers, and of the lengths of texts and lists.
LIMITS: dict[str, Callable[[Any, Any], bool]] = {
    "exclusiveMinimum": gt,
    "minimum": ge,
    "minLength": ge,
    "minItems": ge,
    "exclusiveMaximum": lt,
    "maximum": le,
    "maxLength": le,
    "maxItems": le,
}


class ValueCheck:
    """Check of a document by its schema.  problems: path and reason of each problem."""

    def __init__(self) -> None:
        self.problems: list[tuple[Path_, str]] = []

    def value(self, node: Node, value: Any, path: Path_ = (), is_filled: bool = True) -> Any:
        """Return a value as plain types of its schema, or unchanged after adding to `problems`.

        node: the schema.  is_filled: whether omitted keys get their defaults.
        """
        node = follow_reference(node)
        if node.get("type") == BLOCK and (value is None or isinstance(value, dict)):
            return self._block(node, value or {}, path, is_filled and "required" in node)
        options = node.get("anyOf", [node])
        if value is None and NULL in options:
            return None
        is_list = isinstance(value, list | tuple)
        option = next((o for o in options if is_list == (o["type"] == "array")), options[0])
        is_pair = not is_list and options[-1]["type"] == "array"
        value = self._plain_value(node, option, value, path)
        return [value, value] if is_pair else value

    def _plain_value(self, node: Node, option: Node, value: Any, path: Path_) -> Any:
        """Return a value that is no block as plain types of a schema's option; see `value`."""
        if not fits(option, value):
            self.problems.append((path, wrong_value(path, value, node)))
        elif option["type"] == "array":
            items = option.get("prefixItems") or [option["items"]] * len(value)
            pairs = enumerate(zip(items, value, strict=True))
            return [self.value(item, inner, (*path, n)) for n, (item, inner) in pairs]
        elif option["type"] == "number":
            return float(value)
        return value

    def _block(self, node: Node, values: Any, path: Path_, is_filled: bool) -> dict[str, Any]:
        if "patternProperties" in node:
            return {name: self._named_block(node, name, values[name], path) for name in values}
        keys, checked = node["properties"], {}
        for name, inner in keys.items():
            place = (*path, name)
            if name in values:
                checked[name] = self.value(inner, values[name], place, is_filled)
            elif is_filled and "default" in inner:
                checked[name] = self.value(inner, inner["default"], place)
            elif name in node.get("required", ()):
                self.problems.append((place, missing_key(place, inner)))
        if "additionalProperties" in node:
            for name in [name for name in values if name not in keys]:
                self.problems.append(((*path, name), unknown_key((*path, name), keys)))
        return checked

    def _named_block(self, node: Node, name: str, values: Any, path: Path_) -> Any:
        """Return a block whose name the user chose, such as a motion; see `value`."""
        if not re.fullmatch(NAME, name):
            self.problems.append(((*path, name), wrong_name(name)))
        return self.value(entry_below(node, name, values) or {}, values, (*path, name))


def fits(node: Node, value: Any) -> bool:
    """Whether a value is of the node's type and within its bounds, apart from a list's items."""
    if type(value) not in TYPES.get(node["type"], ()):
        return False
    if "enum" in node:
        return value in node["enum"]
    if "pattern" in node and not re.fullmatch(node["pattern"], value):
        return False
    size = len(value) if isinstance(value, str | list | tuple) else value
    return -inf < size < inf and all(
        is_in(size, node[word]) for word, is_in in LIMITS.items() if word in node
    )


def resolve(values: Any) -> tuple[dict[str, Any], list[tuple[Path_, str]]]:
    """Check the keys of a document and fill in all defaults.

    Returns every key with its value, with the common keys of facets and detectors written out for
    each; or an empty dict, and the path and the reason of each problem.
    """
    check = ValueCheck()
    plain = check.value(document(), values)
    if check.problems:
        return {}, check.problems
    del plain["extends"]
    for block in ("mirror", "psd"):
        plain["sensor"][block] = _single_blocks(plain["sensor"][block])
    return plain, []


def _single_blocks(common: dict[str, Any]) -> dict[str, Any]:
    """The blocks a, b and c with all keys: a key of the block itself, else the common key, else the
    nominal azimuth."""
    parts = {name: common.pop(name) for name in DETECTORS}
    return {
        name: _overlay({**deepcopy(common), "azimuth_deg": 120.0 * k}, part)
        for k, (name, part) in enumerate(parts.items())
    }


def _overlay(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Return `below` with its keys replaced by the keys of `above`, block by block."""
    blocks = {
        key: _overlay(below[key], value) if isinstance(value, dict) else value
        for key, value in above.items()
    }
    return {**below, **blocks}
