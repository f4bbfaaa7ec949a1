"""Write the problems of a file as `FILE:LINE: key.path: reason (got VALUE; allowed ...)`."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from typing import Any

from ..core.plain_numbers import suggest_name
from .json_schema import advice_on_key, describe_values
from .nodes import BLOCK, Node
from .yaml_positions import Marked, Path_, dotted_path


def messages(problems: list[tuple[Path_, str]], tree: Marked) -> list[str]:
    """Write a line for each problem, a path with a reason, in the order of files and lines."""
    lines = {}
    for path, reason in problems:
        mark, _ = tree.find(path)
        lines[f"{mark.place}: {dotted_path(path)}: {reason}"] = str(mark.file), mark.line
    return sorted(lines, key=lambda text: lines[text])


def wrong_name(name: str) -> str:
    return f"a name is letters, digits, '.', '_' and '-' (got {quote_value(name)})"


def unknown_key(path: Path_, allowed: Iterable[str]) -> str:
    return f"unknown key{advice_on_key(path, list(allowed))} (allowed: {', '.join(allowed)})"


def missing_key(path: Path_, node: Node) -> str:
    return f"is missing (allowed: {describe_values(path, node)})"


def wrong_value(path: Path_, value: Any, node: Node) -> str:
    allowed = describe_values(path, node)
    return f"{_reason(value, node, allowed)} (got {quote_value(value)}; allowed: {allowed})"


def _reason(value: Any, node: Node, allowed: str) -> str:
    if value is None:
        return "has no value"
    if node.get("type") == BLOCK:
        return "must be a block of keys"
    if "enum" in node:
        return f"is not one of the words allowed{suggest_name(str(value), node['enum'])}"
    if "number" in allowed:
        return _reason_of_number(value, allowed)
    return f"must be {allowed}"


def _reason_of_number(value: Any, allowed: str) -> str:
    if isinstance(value, str):
        return "must be a number, not text" + _advice(value)
    if isinstance(value, list):
        takes_list = "two" in allowed or "list" in allowed
        return f"must be {_count_in_words(allowed) if takes_list else 'one number, not a list'}"
    if not is_number(value):
        return "must be a number"
    if "list" in allowed:
        return f"must be {_count_in_words(allowed)}"
    if not -math.inf < value < math.inf:  # math.isfinite fails for very large integers
        return "must be a finite number"
    if "whole" in allowed and isinstance(value, float):
        return "must be a whole number"
    return "is out of range"


def _count_in_words(allowed: str) -> str:
    """Find '9 numbers' in 'a list of 9 numbers from ...'."""
    match = re.search(r"(?:list of|one or) (\w+ (?:lists of \w+ )?numbers)", allowed)
    return match[1] if match else "two numbers"


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _advice(text: str) -> str:
    """Advise how to correct a text that is nearly a number; "" for other texts."""
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
