"""Write pydantic's findings as `FILE:LINE: key.path: reason (got VALUE; allowed ...)`."""

from __future__ import annotations

import json
import math
import re
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from .json_schema import allowed_values, entry, key_names, suggest_name, suggestion
from .yaml_positions import Marked, Path_, dotted_path


def messages(error: ValidationError, tree: Marked) -> list[str]:
    """A line for each problem, in the order of the file."""
    plain = tree.plain()
    texts = [_message_at(details, tree, plain) for details in error.errors()]
    lines = {text: (str(mark.file), mark.line) for text, mark in texts}
    return sorted(lines, key=lambda text: lines[text])


def _message_at(details: ErrorDetails, tree: Marked, plain: Any) -> tuple[str, Marked]:
    path = _path_in_file(details, plain)
    kind = details["type"]
    mark, reached = tree.find(path)
    if kind == "extra_forbidden":
        reason = _unknown_key(path, plain)
    elif kind == "string_pattern_mismatch":
        reason = (
            f"a motion's name is letters, digits, '.', '_' and '-' (got {quote_value(path[-1])})"
        )
    elif kind == "value_error":
        reason = details["msg"].removeprefix("Value error, ")
    elif reached != path and not isinstance(mark.value, dict):  # A single number may stand for two.
        path, reason = reached, _wrong_value(reached, mark, plain)
    elif reached != path:
        reason = _missing_key(path, plain)
    else:
        reason = _wrong_value(path, mark, plain)
    return f"{mark.place}: {dotted_path(path)}: {reason}", mark


def _path_in_file(details: ErrorDetails, plain: Any) -> Path_:
    """The path in the file, without the kind that pydantic adds inside a motion."""
    path = details["loc"]
    if path[0] == "motions" and len(path) > 2:
        path = path[:2] + path[3:] if path[2] != "[key]" else path[:2]
    if details["type"].startswith("union_tag"):
        return (*path, "kind")
    if details["type"] == "missing" and isinstance(path[-1], int):
        return path[:-1]
    return path


def _unknown_key(path: Path_, plain: Any) -> str:
    hint = suggestion(path, plain)
    known = ", ".join(key_names(path[:-1], plain))
    return f"unknown key{hint and '; ' + hint} (allowed: {known})"


def _missing_key(path: Path_, plain: Any) -> str:
    return f"is missing (allowed: {allowed_values(path, plain)})"


def _wrong_value(path: Path_, mark: Marked, plain: Any) -> str:
    value = mark.plain()
    may = allowed_values(path, plain)
    reason = _reason(value, entry(path, plain) or {}, may)
    return f"{reason} (got {quote_value(value)}; allowed: {may})"


def _reason(value: Any, node: dict[str, Any], may: str) -> str:
    if value is None:
        return "has no value"
    if node.get("type") == "object":
        return "must be a block of keys"
    if "enum" in node:
        near = suggest_name(str(value), node["enum"])
        return f"is not one of the words allowed{near and '; ' + near}"
    if "number" in may:
        return _reason_of_number(value, may)
    return f"must be {may}"


def _reason_of_number(value: Any, may: str) -> str:
    if isinstance(value, str):
        return "must be a number, not text" + _advice(value)
    if isinstance(value, list):
        takes_list = "two" in may or "list" in may
        return f"must be {_count_in_words(may) if takes_list else 'one number, not a list'}"
    if not is_number(value):
        return "must be a number"
    if "list" in may:
        return f"must be {_count_in_words(may)}"
    if not math.isfinite(value):
        return "must be a finite number"
    if "whole" in may and isinstance(value, float):
        return "must be a whole number"
    return "is out of range"


def _count_in_words(may: str) -> str:
    """Find the number of items in 'a list of 9 numbers from ...'."""
    match = re.search(r"(?:list of|one or) (\w+ (?:pairs of )?numbers)", may)
    return match[1] if match else "two numbers"


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _advice(text: str) -> str:
    """Advise how to turn text into a number, where the text nearly is one."""
    if re.fullmatch(r"\s*[-+]?\d+,\d+\s*", text):
        return "; write the decimals after a point"
    if re.match(r"\s*[-+]?[\d.]+\s*[a-zA-Z]+\s*$", text):
        return "; leave the unit out, because the key names it"
    if re.fullmatch(r"\s*[-+]?[\d.]+([eE][-+]?\d+)?\s*", text):
        return "; remove the quotes"
    return ""


def quote_value(value: Any) -> str:
    """Write a value as YAML, shortened if long."""
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if value is None:
        return "nothing"
    if isinstance(value, list):
        text = f"[{', '.join(quote_value(item) for item in value)}]"
    else:
        text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
