"""The JSON Schema of a certificate of uniqueness, and the part of JSON Schema that enforces it.

`python -m facets.experiments.check_certificate --schema` prints it.
"""

from __future__ import annotations

import math
from typing import Any

FORMAT = "facets uniqueness certificate 2"


class Refused(Exception):
    """The certificate is no proof; the message says why."""


def array(item: Any, count: int) -> dict[str, Any]:
    return {"type": "array", "items": item, "minItems": count, "maxItems": count}


NUMBER = {"type": "number"}
LENGTH = {"type": "number", "minimum": 0}
TEXT = {"type": "string"}
INTERVAL = array(NUMBER, 2)


def record(properties: dict[str, Any], optional: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": [name for name in properties if name not in optional],
        "additionalProperties": False,
    }


PIECE = record({"low": array(NUMBER, 6), "high": array(NUMBER, 6), "at_least": LENGTH})
LIGHT = record(
    {
        "from_point": array(array(INTERVAL, 2), 3),
        "turns": array(array(array(INTERVAL, 3), 2), 3),
        "slope": INTERVAL,
    }
)
AFFINE = record(
    {
        "place": array(NUMBER, 6),
        "value": array(array(NUMBER, 6), 6),
        "slopes": array(array(array(NUMBER, 6), 6), 6),
    }
)
ABOUT = (
    "config",
    "config_sha256",
    "object",
    "facets",
    "seed",
    "command",
    "made",
    "seconds",
    "work",
    "middles",
    "range",
)
SCHEMA: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": FORMAT,
    "description": "Lengths mm, angles rad, powers mW.",
    **record(
        {
            "format": {"const": FORMAT},
            "config": TEXT,
            "config_sha256": {"type": "string", "pattern": "^[0-9a-f]{64}$"},
            "object": TEXT,
            "facets": TEXT,
            "seed": TEXT,
            "command": TEXT,
            "made": TEXT,
            "seconds": LENGTH,
            "work": {"type": "integer", "minimum": 0},
            "resolved": {"type": ["object", "null"]},
            "parameters": array(NUMBER, 30),
            "tolerances": array(LENGTH, 30),
            "low": array(NUMBER, 6),
            "high": array(NUMBER, 6),
            "least_share": {"type": "number", "exclusiveMinimum": 0, "maximum": 1 / 3},
            "regular": {"const": True},
            "unique": {"const": True},
            "margin": {"type": "number", "exclusiveMinimum": 0, "maximum": 1},
            "least_determinant": LENGTH,
            "reason": {"const": ""},
            "light": LIGHT,
            "middles": {**AFFINE, "type": ["object", "null"]},
            "inverse": array(array(NUMBER, 6), 6),
            "weights": array({"type": "number", "exclusiveMinimum": 0}, 6),
            "pieces": {"type": "array", "items": PIECE, "minItems": 1},
            "doubtful": {"type": "array", "items": PIECE, "maxItems": 0},
            "range": {"type": ["object", "null"]},
        },
        ABOUT,
    ),
}
KINDS = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def is_of_kind(value: Any, kind: str) -> bool:
    """Whether a value has this type; a Boolean is not a number, nor is NaN or infinity."""
    if kind in ("number", "integer"):
        whole = isinstance(value, int) and not isinstance(value, bool)
        return whole or (kind == "number" and isinstance(value, float) and math.isfinite(value))
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
    missing = [name for name in schema["required"] if name not in value]
    refuse_unless(not missing, f"{where} lacks {', '.join(missing)}")
    unknown = [name for name in value if name not in schema["properties"]]
    refuse_unless(not unknown, f"{where} has {', '.join(unknown)}, of which nothing is known")
    for name, part in value.items():
        conform(part, schema["properties"][name], f"{where}: {name}")


def conform_array(value: list[Any], schema: dict[str, Any], where: str) -> None:
    least, most = schema.get("minItems", 0), schema.get("maxItems", math.inf)
    refuse_unless(least <= len(value) <= most, f"{where} has {len(value)} entries; needed: {least}"
                  f" to {most}")  # fmt: skip
    for number, part in enumerate(value):
        conform(part, schema["items"], f"{where}[{number}]")


def conform_number(value: float, schema: dict[str, Any], where: str) -> None:
    least, most = schema.get("minimum", -math.inf), schema.get("maximum", math.inf)
    above = schema.get("exclusiveMinimum", -math.inf)
    inside = least <= value <= most and value > above
    refuse_unless(inside, f"{where} is {value}; needed: {max(least, above)} to {most}")
    refuse_unless(abs(value) < 1e300, f"{where} is {value}, too large for a number of this kind")


def refuse_unless(holds: bool, reason: str) -> None:
    if not holds:
        raise Refused(reason)
