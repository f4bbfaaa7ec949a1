"""The JSON Schema of a certificate of uniqueness (certificate_schema.json), and the part of JSON
Schema that enforces it.

`python -m facets.experiments.check_certificate --schema` prints it.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

#: The schema of the whole file; any other program can use certificate_schema.json as it is.
SCHEMA: dict[str, Any] = json.loads(Path(__file__).with_suffix(".json").read_text("utf-8"))


class Refused(Exception):
    """The certificate is no proof; the message says why."""


KINDS = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def is_of_kind(value: Any, kind: str) -> bool:
    """Whether a value has this type; a Boolean is not a number, nor is NaN or infinity."""
    if kind in ("number", "integer"):
        is_integer = isinstance(value, int) and not isinstance(value, bool)
        return is_integer or (
            kind == "number" and isinstance(value, float) and math.isfinite(value)
        )
    return isinstance(value, KINDS[kind])


def conform(value: Any, schema: dict[str, Any], where: str = "the file") -> None:
    """Raise `Refused` if a value does not conform to its schema."""
    if "const" in schema:
        same = type(value) is type(schema["const"]) and value == schema["const"]
        refuse_unless(same, f"{where} is {value!r:.60}; needed: {schema['const']!r}")
        return
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    fits = any(is_of_kind(value, kind) for kind in kinds)
    refuse_unless(fits, f"{where} is {value!r:.60}; needed: {' or '.join(kinds)}, finite")
    if isinstance(value, dict) and "properties" in schema:
        conform_record(value, schema, where)
    elif isinstance(value, list):
        conform_array(value, schema, where)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        conform_number(value, schema, where)


def conform_record(value: dict[str, Any], schema: dict[str, Any], where: str) -> None:
    """Check the names and parts of a record; raises `Refused`."""
    missing = [name for name in schema["required"] if name not in value]
    refuse_unless(not missing, f"{where} lacks {', '.join(missing)}")
    unknown = [name for name in value if name not in schema["properties"]]
    refuse_unless(not unknown, f"{where} has {', '.join(unknown)}, of which nothing is known")
    for name, part in value.items():
        conform(part, schema["properties"][name], f"{where}: {name}")


def conform_array(value: list[Any], schema: dict[str, Any], where: str) -> None:
    """Check the length and the parts of an array; raises `Refused`."""
    fewest, most = schema.get("minItems", 0), schema.get("maxItems", math.inf)
    refuse_unless(fewest <= len(value) <= most, f"{where} has {len(value)} entries; needed:"
                  f" {fewest} to {most}")  # fmt: skip
    for number, part in enumerate(value):
        conform(part, schema["items"], f"{where}[{number}]")


def conform_number(value: float, schema: dict[str, Any], where: str) -> None:
    """Check the limits of a number; raises `Refused`."""
    minimum, most = schema.get("minimum", -math.inf), schema.get("maximum", math.inf)
    above = schema.get("exclusiveMinimum", -math.inf)
    inside = minimum <= value <= most and value > above
    refuse_unless(inside, f"{where} is {value}; needed: {max(minimum, above)} to {most}")
    refuse_unless(abs(value) < 1e300, f"{where} is {value}, too large for a number of this kind")


def refuse_unless(holds: bool, reason: str) -> None:
    """Raise `Refused` with a reason unless a condition holds."""
    if not holds:
        raise Refused(reason)
