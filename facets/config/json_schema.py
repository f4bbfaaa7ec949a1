"""The JSON Schema of a configuration, for editors, and what it says about each key."""

from __future__ import annotations

import copy
import difflib
from collections.abc import Iterator
from functools import cache
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from ..core.units import KEY_UNITS, unit_in
from .keys import Document
from .yaml_positions import Path_


class _Untitled(GenerateJsonSchema):
    """A generator that leaves out titles, which would only repeat the keys."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


@cache
def document() -> dict[str, Any]:
    """The schema of a complete configuration without inherited keys."""
    return Document.model_json_schema(by_alias=True, schema_generator=_Untitled)


def schema() -> dict[str, Any]:
    """JSON Schema, draft 2020-12, of a configuration file, for editors.

    It accepts more than `load` where a single file cannot decide: a motion may leave out inherited
    keys, be empty to remove an inherited motion, and a block may be empty.
    """
    body = copy.deepcopy(document())
    for block in body["$defs"].values():
        block["type"] = ["object", "null"]
        block.pop("required", None)
    motions = body["properties"]["motions"]
    motions["type"] = ["object", "null"]
    for any_motion in motions["patternProperties"].values():
        any_motion["anyOf"] = any_motion.pop("oneOf")
        any_motion.pop("discriminator")
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, **body, "title": "facets configuration"}


def entry(path: Path_, plain: Any = None) -> dict[str, Any] | None:
    """Return the schema of the key at `path`; None for an unknown key.

    plain: the document's values, which tell the kind of each motion.
    """
    node: dict[str, Any] | None = document()
    for key in path:
        plain = plain.get(key) if isinstance(plain, dict) else None
        node = _entry_below(node or {}, key, plain)
        if node is None:
            return None
    return node


def _entry_below(node: dict[str, Any], key: str | int, plain: Any) -> dict[str, Any] | None:
    if isinstance(key, int):
        return _entry_of_item(node, key)
    inner = node.get("properties", {}).get(key)
    if inner is None and isinstance(node.get("additionalProperties"), dict):
        inner = node["additionalProperties"]
    elif inner is None and "patternProperties" in node:
        inner = next(iter(node["patternProperties"].values()))
    if inner is None:
        return None
    if "discriminator" not in inner:
        return _follow_reference(inner)
    kinds = inner["discriminator"]["mapping"]
    kind = plain.get("kind") if isinstance(plain, dict) else None
    if isinstance(kind, str) and kind in kinds:
        return _follow_reference({"$ref": kinds[kind]})
    # The other keys depend on the kind.
    return {"type": "object", "properties": {"kind": {"enum": list(kinds)}}}


def _entry_of_item(node: dict[str, Any], place: int) -> dict[str, Any] | None:
    """The allowed item of a list at a place."""
    for option in (node, *node.get("anyOf", [])):
        if place < len(option.get("prefixItems", [])):
            item: dict[str, Any] = option["prefixItems"][place]
            return item
        if "items" in option:
            return _follow_reference(option["items"])
    return node


def _follow_reference(node: dict[str, Any]) -> dict[str, Any]:
    if "$ref" not in node:
        return node
    target = document()["$defs"].get(node["$ref"].removeprefix("#/$defs/"), {})
    return {**target, **{k: v for k, v in node.items() if k != "$ref"}}


def unit(path: Path_) -> str:
    """The unit in a key's name, or ""; axes of `cycles` and `phase_deg` have the block's unit."""
    keys = [key for key in path if isinstance(key, str)]
    if path[0] == "motions" and len(keys) == 4 and keys[2] in ("cycles", "phase_deg"):
        keys.pop()
    ending = unit_in(keys[-1])
    return KEY_UNITS[ending].label if ending else ""


def allowed_values(path: Path_, plain: Any = None) -> str:
    """The allowed values of a key in words: 'a number above 0, up to 1000 mm'."""
    node = entry(path, plain)
    if node is None:
        return ""
    if node.get("type") == "object":
        return ", ".join(node.get("properties", {})) or "a name for each block below it"
    ending = f" {unit(path)}" if _is_numeric(node) and unit(path) else ""
    if {"type": "null"} in node.get("anyOf", []):
        return f"{_type_in_words(node['anyOf'][0])}{ending}, or null for none"
    return _type_in_words(node) + ending


def _is_numeric(node: dict[str, Any]) -> bool:
    return node.get("type") in ("number", "integer", "array") or (
        "anyOf" in node and any(_is_numeric(option) for option in node["anyOf"])
    )


def _type_in_words(node: dict[str, Any]) -> str:
    if "enum" in node or "const" in node:
        return ", ".join(node.get("enum", [node.get("const")]))
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
    words = {"boolean": "true or false", "string": "text"}
    return words.get(str(kind), "")


COUNTS = {2: "two", 3: "three", 6: "six"}


def _list_in_words(node: dict[str, Any]) -> str:
    """The allowed list in words: 'a list of two numbers from 0 to 100'."""
    inner = node["items"] if "items" in node else node["prefixItems"][0]
    count = node.get("minItems", "")
    many = COUNTS.get(count, str(count))
    if "$ref" in inner:
        keys = ", ".join(_follow_reference(inner)["properties"])
        return f"a list of up to {node['maxItems']} blocks, each of the keys {keys}"
    if inner.get("type") == "array":
        return f"a list of {many} pairs of numbers{_range_in_words(inner['prefixItems'][0])}"
    return f"a list of {many} numbers{_range_in_words(inner)}"


def _range_in_words(node: dict[str, Any]) -> str:
    bound = {key: f"{node[key]:.15g}" for key in node if "imum" in key.lower()}
    if "minimum" in bound and "maximum" in bound:
        return f" from {bound['minimum']} to {bound['maximum']}"
    low = f" above {bound['exclusiveMinimum']}" if "exclusiveMinimum" in bound else ""
    low = f" from {bound['minimum']}" if "minimum" in bound else low
    high = f" up to {bound['maximum']}" if "maximum" in bound else ""
    high = f" below {bound['exclusiveMaximum']}" if "exclusiveMaximum" in bound else high
    return low + ("," if low and high else "") + high


def key_names(path: Path_, plain: Any = None) -> list[str]:
    """The keys that a block may hold."""
    node = entry(path, plain) or {}
    return list(node.get("properties", {}))


def suggest_name(wrong: str, right: list[str]) -> str:
    """Suggest the nearest right name: 'did you mean ...?', or "" if none is near."""
    near = difflib.get_close_matches(wrong, right, n=1, cutoff=0.55)
    return f"did you mean {near[0]!r}?" if near else ""


def suggestion(path: Path_, plain: Any = None) -> str:
    """Suggest the nearest right name for an unknown key, or the block to which it belongs."""
    *block, wrong = path
    here = key_names(tuple(block), plain)
    if near := suggest_name(str(wrong), here):
        return near
    elsewhere = [".".join(map(str, p)) for p in _all_paths(()) if p[-1] == wrong]
    if not elsewhere:
        return ""
    above = elsewhere[0].rpartition(".")[0]
    return f"it belongs in {above}" if above else "it belongs at the file's top level"


def _all_paths(path: Path_) -> Iterator[Path_]:
    for name in key_names(path):
        yield (*path, name)
        yield from _all_paths((*path, name))
