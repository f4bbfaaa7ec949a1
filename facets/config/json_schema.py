"""The JSON Schema of configurations for editors, and the allowed values of a key in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..core.plain_numbers import suggest_name
from ..core.units import KEY_UNITS, unit_in
from .nodes import BLOCK, NULL, Node, document
from .yaml_positions import Path_, dotted_path


def schema() -> Node:
    """Return the JSON Schema, draft 2020-12, of a configuration file, for editors.

    It accepts files that are valid only with the files that they extend: a motion may omit
    inherited keys or be empty to remove an inherited motion, and a block may be empty.
    """
    dialect = "https://json-schema.org/draft/2020-12/schema"
    blocks = document()["$defs"]
    return {
        "$schema": dialect,
        **_editors_node(document()),
        "$defs": {name: _editors_node(block) for name, block in blocks.items()},
        "title": "facets configuration",
    }


def _editors_node(block: Node) -> Node:
    return {word: value for word, value in block.items() if word != "required"}


def entry(path: Path_, plain: Any = None) -> Node | None:
    """Return the schema of the key at `path`; None for an unknown key.

    plain: the document's values, which contain the kind of each motion.
    """
    node: Node | None = document()
    for key in path:
        plain = plain.get(key) if isinstance(plain, dict) else None
        node = entry_below(node or {}, key, plain)
        if node is None:
            return None
    return node


def entry_below(node: Node, key: str | int, plain: Any) -> Node | None:
    if isinstance(key, int):
        return _entry_of_item(node, key)
    inner = node.get("properties", {}).get(key)
    if inner is None and "patternProperties" in node:
        (inner,) = node["patternProperties"].values()
        if "anyOf" in inner:
            return _motion_entry(inner["anyOf"], plain)
    return None if inner is None else follow_reference(inner)


def _motion_entry(references: list[Node], plain: Any) -> Node:
    """The schema of a motion of the kind in `plain`; without a known kind, of the key `kind` alone.

    references: schemas of all kinds.
    """
    blocks = map(follow_reference, references)
    kinds = {block["properties"]["kind"]["enum"][0]: block for block in blocks}
    kind = plain.get("kind") if isinstance(plain, dict) else None
    if isinstance(kind, str) and kind in kinds:
        return kinds[kind]
    word = {"enum": sorted(kinds), "type": "string"}
    return {"type": BLOCK, "properties": {"kind": word}, "required": ["kind"]}


def _entry_of_item(node: Node, place: int) -> Node | None:
    """The schema of a list's item at an index."""
    for option in (node, *node.get("anyOf", [])):
        if place < len(option.get("prefixItems", [])):
            item: Node = option["prefixItems"][place]
            return item
        if "items" in option:
            return follow_reference(option["items"])
    return node


def follow_reference(node: Node) -> Node:
    if "$ref" not in node:
        return node
    target = document()["$defs"].get(node["$ref"].removeprefix("#/$defs/"), {})
    return {**target, **{k: v for k, v in node.items() if k != "$ref"}}


def unit(path: Path_) -> str:
    """The unit in a key's name, or ""; for the axes in `cycles` and `phase_deg`, the unit in the
    block's name."""
    keys = [key for key in path if isinstance(key, str)]
    if path[0] == "motions" and len(keys) == 4 and keys[2] in ("cycles", "phase_deg"):
        keys.pop()
    ending = unit_in(keys[-1])
    return KEY_UNITS[ending].label if ending else ""


def allowed_values(path: Path_, plain: Any = None) -> str:
    """The allowed values of a key in words: 'a number above 0, up to 1000 mm'."""
    node = entry(path, plain)
    return "" if node is None else describe_values(path, node)


def describe_values(path: Path_, node: Node) -> str:
    """The allowed values of a key in words, from its schema."""
    node = follow_reference(node)
    if node.get("type") == BLOCK:
        return ", ".join(node.get("properties", {})) or "a name for each block below it"
    ending = f" {unit(path)}" if _is_numeric(node) and unit(path) else ""
    if NULL in node.get("anyOf", []):
        return f"{_type_in_words(node['anyOf'][0])}{ending}, or null for none"
    return _type_in_words(node) + ending


def _is_numeric(node: Node) -> bool:
    return node.get("type") in ("number", "integer", "array") or (
        "anyOf" in node and any(_is_numeric(option) for option in node["anyOf"])
    )


def _type_in_words(node: Node) -> str:
    if "enum" in node:
        return ", ".join(node["enum"])
    if "anyOf" in node:
        first = node["anyOf"][0]
        return (
            f"one or two numbers{_range_in_words(first)}"
            if _is_numeric(first)
            else _type_in_words(first)
        )
    kind = node.get("type")
    if kind == "array":
        return _list_in_words(node)
    if kind in ("number", "integer"):
        return f"a {'whole ' if kind == 'integer' else ''}number{_range_in_words(node)}"
    if kind == "string":
        return str(node.get("patternErrorMessage", "text")).removeprefix("must be ")
    return "true or false"


COUNTS = {2: "two", 3: "three", 6: "six"}


def _list_in_words(node: Node) -> str:
    """Describe an allowed list: 'a list of two numbers from 0 to 100'."""
    inner = node["items"] if "items" in node else node["prefixItems"][0]
    count = node.get("minItems", "")
    many = COUNTS.get(count, str(count))
    if "$ref" in inner:
        keys = ", ".join(follow_reference(inner)["properties"])
        return f"a list of up to {node['maxItems']} blocks, each of the keys {keys}"
    if inner.get("type") == "array":
        return _list_in_words(inner).replace("a list", f"a list of {many} lists")
    return f"a list of {many} numbers{_range_in_words(inner)}"


def _range_in_words(node: Node) -> str:
    bound = {key: f"{node[key]:.15g}" for key in node if "imum" in key.lower()}
    if "minimum" in bound and "maximum" in bound:
        return f" from {bound['minimum']} to {bound['maximum']}"
    low = f" above {bound['exclusiveMinimum']}" if "exclusiveMinimum" in bound else ""
    low = f" from {bound['minimum']}" if "minimum" in bound else low
    high = f" up to {bound['maximum']}" if "maximum" in bound else ""
    high = f" below {bound['exclusiveMaximum']}" if "exclusiveMaximum" in bound else high
    return low + ("," if low and high else "") + high


def key_names(path: Path_) -> list[str]:
    """Names of the keys that the block at a path may hold."""
    node = entry(path) or {}
    return list(node.get("properties", {}))


TOP_LEVEL = "at the file's top level"


def advice_on_key(path: Path_, allowed: list[str]) -> str:
    """Suggest the nearest allowed name for an unknown key, or the block to which the key belongs;
    "" if there is neither."""
    wrong = path[-1]
    if near := suggest_name(str(wrong), allowed):
        return near
    for *above, name in _all_paths(()):
        if name == wrong:
            return f"; it belongs {f'in {dotted_path(tuple(above))}' if above else TOP_LEVEL}"
    return ""


def _all_paths(path: Path_) -> Iterator[Path_]:
    for name in key_names(path):
        yield (*path, name)
        yield from _all_paths((*path, name))
