"""Short descriptions of objects: one line for terminals, with a table below it for notebooks.

Both follow from the fields of a class and from the keys that are declared on them (`core.keys`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from math import degrees
from typing import Any, TypeVar

from .hues import LIGHT
from .names import DETECTORS
from .units import KEY_UNITS

Kind = TypeVar("Kind", bound=type[Any])
#: Largest number of items of a sequence that is shown in full, and of characters in a line.
MAX_ITEMS, MAX_CHARACTERS = 9, 160
#: Number of rows of a table of results in a notebook.
SHOWN_ROWS = 5


def show_shortly(kind: Kind) -> Kind:
    """Give a class a short `repr`, and a table of its contents for notebooks."""
    kind.__repr__ = describe  # type: ignore[assignment]
    kind._repr_html_ = describe_as_html
    return kind


def describe(result: Any) -> str:
    """Describe an object in one line: its summary if it has one, else the fields that differ from
    their defaults."""
    name = next(kind.__name__ for kind in type(result).__mro__ if "__repr__" in vars(kind))
    summary = getattr(result, "summary", None)
    if isinstance(summary, str):
        return f"{name}: {summary}"
    parts = [f"{field}={write_value(value)}" for field, value in changed_fields(result)]
    line = f"{name}({', '.join(parts)})"
    return line if len(line) <= MAX_CHARACTERS else f"{line[: MAX_CHARACTERS - 4]} ...)"


def changed_fields(result: Any) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of the fields that differ from their defaults."""
    for field in fields(result):
        value = getattr(result, field.name)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        if type(value) is not type(default) or hasattr(value, "shape") or value != default:
            yield field.name, value


def write_value(value: Any) -> str:
    """Write a value in a few words; arrays and long sequences by their size."""
    if hasattr(value, "shape") and value.shape:
        return f"array{value.shape}".replace(",)", ")")
    if isinstance(value, dict):
        return ", ".join(map(str, value))
    if isinstance(value, tuple | list) and len(value) > MAX_ITEMS:
        return f"{len(value)} values"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(write_value, value))})"
    return f"{value:.6g}" if isinstance(value, float) else repr(value)


def describe_as_html(result: Any) -> str:
    """Describe an object in HTML: one line, and the first rows of its table or the keys that differ
    from their defaults; for a sensor, also a plan of the head."""
    import pandas as pd

    if hasattr(result, "to_frame"):
        table = result.to_frame().head(SHOWN_ROWS)
    else:
        table = pd.DataFrame(changed_keys(result), columns=["key", "value", "unit", "meaning"])
    plan = draw_plan(result) if hasattr(result, "psds") else ""
    line = describe(result).replace("<", "&lt;")
    return f"<p>{line}</p>{table.to_html() if len(table) else ''}{plan}"


def changed_keys(result: Any, prefix: str = "") -> Iterator[tuple[str, str, str, str]]:
    """Yield key, value, unit and meaning of the fields that differ from their defaults, including
    fields of the object's parts."""
    sources = {field.name: field.metadata.get("source") for field in fields(result)}
    for name, value in changed_fields(result):
        parts = dict(zip(DETECTORS, value, strict=False)) if isinstance(value, tuple) else {}
        if is_dataclass(value):
            yield from changed_keys(value, f"{prefix}{name}.")
        elif parts and all(map(is_dataclass, parts.values())):
            for letter, part in parts.items():
                yield from changed_keys(part, f"{prefix}{name}.{letter}.")
        elif (source := sources[name]) is None or source.keys[0].block is not None:
            yield f"{prefix}{name}", write_value(value), "", ""
        else:
            keys = source.keys if source.write else source.keys[:1]
            numbers = source.write(value) if source.write else [keys[0].write(value)]
            for key, number in zip(keys, numbers, strict=True):
                unit = KEY_UNITS[key.unit].label if key.unit else ""
                place = "" if source.index is None else f"[{source.index}]"
                yield f"{prefix}{key.name}{place}", write_value(number), unit, key.meaning


def draw_plan(sensor: Any) -> str:
    """Draw a sensor's detectors and the sub-beams to them from above, as SVG."""
    shapes, size = [], 1.3 * max(psd.radius for psd in sensor.psds)
    for letter, psd in zip(DETECTORS, sensor.psds, strict=True):
        turn = degrees(psd.azimuth)
        shapes.append(
            f'<g transform="rotate({-turn:.4g})" stroke="{LIGHT.detectors[letter]}">'
            f'<path d="M0 0H{psd.radius:.4g}" stroke-width="{size / 100:.4g}" '
            f'stroke-dasharray="{size / 30:.4g}"/><path d="M{psd.radius:.4g} '
            f'{-psd.size_y / 2:.4g}v{psd.size_y:.4g}" stroke-width="{size / 20:.4g}"/>'
            f'<text stroke="none" font-size="{size / 8:.4g}" transform="translate('
            f'{1.1 * psd.radius:.4g}) rotate({turn:.4g})">{letter.upper()}</text></g>'
        )
    return (
        f'<svg width="200" height="200" viewBox="{-size:.4g} {-size:.4g} {2 * size:.4g} '
        f'{2 * size:.4g}"><title>The head from above</title>{"".join(shapes)}</svg>'
    )
