"""Write a complete configuration as YAML, each key with its meaning."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from ..core.settings import Config
from .json_schema import allowed_values, entry
from .yaml_positions import Path_

PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
WORDS = {"true", "false", "null", "yes", "no", "on", "off", "y", "n"}
COLUMN = 34


def to_yaml(config: Config) -> str:
    """Write YAML that loads to the same configuration, without inheritance and with all
    defaults."""
    head = f"# {config.name}, as resolved; sha256 {config.sha256}"
    return "\n".join([head, *_block_lines(config.resolved, (), config.resolved)]) + "\n"


def _block_lines(keys: dict[str, Any], path: Path_, document: dict[str, Any]) -> Iterator[str]:
    for key, value in keys.items():
        place = (*path, key)
        indent = "  " * len(path)
        if not isinstance(value, dict):
            yield _key_line(f"{indent}{scalar(key)}: {scalar(value)}", place, document)
        elif not value:
            yield f"{indent}{scalar(key)}: {{}}"
        elif _is_place(value):
            yield from _place_lines(indent, key, value)
        else:
            yield f"{indent}{scalar(key)}:"
            yield from _block_lines(value, place, document)


def _key_line(text: str, path: Path_, document: dict[str, Any]) -> str:
    """Write a line with the key's meaning and range; without them for a motion and for all
    detectors except A, so that they appear once."""
    if {"b", "c"} & set(path) or path[0] == "motions":
        return text
    meaning = (entry(path, document) or {}).get("description", "")
    allowed = allowed_values(path, document).removeprefix("a ").removeprefix("number ")
    return f"{text:<{COLUMN}}  # {meaning} ({allowed})"


def _is_place(value: dict[str, Any]) -> bool:
    return "tx_mm" in value


def _place_lines(indent: str, key: str, value: dict[str, Any]) -> Iterator[str]:
    """Write the eight axes of a place in two lines instead of eight."""
    items = [f"{axis}: {scalar(number)}" for axis, number in value.items()]
    yield f"{indent}{key}: {{{', '.join(items[:3])},"
    yield f"{indent}  {', '.join(items[3:])}}}"


def scalar(value: Any) -> str:
    """Write a value in YAML, exact for numbers."""
    if isinstance(value, list):
        return f"[{', '.join(scalar(item) for item in value)}]"
    if isinstance(value, dict):
        items = (f"{scalar(key)}: {scalar(item)}" for key, item in value.items())
        return f"{{{', '.join(items)}}}"
    if isinstance(value, str):
        bare = PLAIN.fullmatch(value) and value.lower() not in WORDS
        return value if bare else json.dumps(value, ensure_ascii=False)
    return json.dumps(value)
