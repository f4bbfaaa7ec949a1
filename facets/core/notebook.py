"""Short descriptions of objects: one line for terminals, with a table below it for notebooks.

Both follow from the fields of a class and from the keys that are declared on them (`core.keys`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from math import degrees, floor, isnan, log10
from typing import Any, TypeVar

from .hues import LIGHT
from .names import DETECTORS
from .units import KEY_UNITS, round_to

Kind = TypeVar("Kind", bound=type[Any])
#: Largest number of items of a sequence that is shown in full, and of characters in a line.
MAX_ITEMS, MAX_CHARACTERS = 9, 160
#: Number of rows of a table of results in a notebook.
SHOWN_ROWS = 5
#: Blocks of a configuration's sensor whose name is not that of the field.
BLOCK_NAMES = {"facets": "mirror", "psds": "psd", "thermal": "temperature"}


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
    parts = [f"{field}={write_value(value)}" for field, value, _ in changed_fields(result)]
    line = f"{name}({', '.join(parts)})"
    return line if len(line) <= MAX_CHARACTERS else f"{line[: MAX_CHARACTERS - 4]} ...)"


def changed_fields(result: Any, base: Any = None) -> Iterator[tuple[str, Any, Any]]:
    """Yield name, value and default of the fields that differ from their defaults.

    base: an object of the same class whose values are the defaults; without one, those of the
    class are.
    Fields without `repr` are skipped: a person does not set them.
    """
    for field in fields(result):
        value = getattr(result, field.name)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        if is_dataclass(base):
            default = getattr(base, field.name)
        is_changed = type(value) is not type(default) or hasattr(value, "shape") or value != default
        if field.repr and is_changed:
            yield field.name, value, default


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

    plan = draw_plan(result) if hasattr(result, "psds") else ""
    more, has_rows = 0, hasattr(result, "to_frame")
    if has_rows:
        rows = result.to_frame()
        more, table = len(rows) - SHOWN_ROWS, join_uncertainties(rows.head(SHOWN_ROWS))
    else:
        keys = changed_keys(result, prefix="sensor." if plan else "")
        table = pd.DataFrame(keys, columns=["key", "value", "unit", "meaning"])
    line = describe(result).replace("<", "&lt;")
    rest = f"<p>... {more:,} more rows</p>" if more > 0 else ""
    return f"<p>{line}</p>{table.to_html(index=has_rows) if len(table) else ''}{rest}{plan}"


def join_uncertainties(table: Any) -> Any:
    """Return a table of results with each value and its uncertainty in one cell, as text.

    Status, which names misfits, and residual are the first columns.
    """
    first = [name for name in ("status", "residual") if name in table]
    joined = {f"u_{part}{name}" for name in table for part in ("", "noise_", "calibration_")}
    others = [name for name in table if name not in {*first, *joined, "misfit"}]
    texts = table[[*first, *others]].astype(object)
    for name in texts:
        sizes = table.get(f"u_{name}", [0.0] * len(table))
        texts[name] = list(map(write_cell, table[name], sizes))
    if "misfit" in table:
        texts["status"] += [", misfit" if misfit else "" for misfit in table["misfit"]]
    return texts


def write_cell(value: Any, uncertainty: float) -> str:
    """Write a value of a table, with its uncertainty unless that is 0 or NaN."""
    if not isinstance(value, float):
        return str(value)
    if isnan(value):
        return ""
    if not uncertainty > 0:
        return f"{round(value, 12):z.4g}"
    return f"{round_to(value, uncertainty)}\u00a0±\u00a0{round_to(uncertainty, uncertainty)}"


def changed_keys(
    result: Any, base: Any = None, prefix: str = ""
) -> Iterator[tuple[str, str, str, str]]:
    """Yield key, value, unit and meaning of the fields that differ from their defaults, including
    fields of the object's parts.  base: as in `changed_fields`."""
    sources = {field.name: field.metadata.get("source") for field in fields(result)}
    for name, value, default in changed_fields(result, base):
        source = sources[name]
        place = f"{prefix}{source.keys[0].name if source else BLOCK_NAMES.get(name, name)}"
        if is_dataclass(value):
            yield from changed_keys(value, default, f"{place}.")
        elif isinstance(default, tuple) and any(map(is_dataclass, default)):
            for letter, part, nominal in zip(DETECTORS, value, default, strict=True):
                yield from changed_keys(part, nominal, f"{place}.{letter}.")
        elif source is None or source.keys[0].block is not None:
            yield place, write_value(value), "", ""
        else:
            keys = source.keys if source.write else source.keys[:1]
            numbers = source.write(value) if source.write else [keys[0].write(value)]
            for key, number in zip(keys, numbers, strict=True):
                unit = KEY_UNITS[key.unit].label if key.unit else ""
                item = "" if source.index is None else f"[{source.index}]"
                yield f"{prefix}{key.name}{item}", write_value(number), unit, key.meaning


def draw_plan(sensor: Any) -> str:
    """Draw a sensor's detectors and the sub-beams to them from above, with a scale, as SVG."""
    shapes, size = [], 1.3 * max(psd.radius for psd in sensor.psds)
    for letter, psd in zip(DETECTORS, sensor.psds, strict=True):
        turn = degrees(psd.azimuth)
        shapes.append(
            f'<g transform="rotate({-turn:.4g})" stroke="{LIGHT.detectors[letter]}">'
            f'<path d="M0 0H{psd.radius:.4g}" stroke-width="{size / 100:.4g}" '
            f'stroke-dasharray="{size / 30:.4g}"/><path d="M{psd.radius:.4g} '
            f'{-psd.size_y / 2:.4g}v{psd.size_y:.4g}" stroke-width="{size / 20:.4g}"/>'
            '<text stroke="none" text-anchor="middle" dominant-baseline="central" '
            f'transform="translate({psd.radius + size / 9:.4g}) rotate({turn:.4g})">'
            f"{letter.upper()}</text></g>"
        )
    scale, corner = 10 ** floor(log10(size)), f"{0.95 * size:.4g}"
    shapes.append(
        f'<path d="M{corner} {corner}h-{scale:g}" stroke="currentColor" '
        f'stroke-width="{size / 50:.4g}"/><text text-anchor="end" dy="-0.3em" '
        f'transform="translate({corner} {corner})">{scale:g} mm</text>'
    )
    return (
        f'<svg width="200" height="200" fill="currentColor" font-size="{size / 8:.4g}" viewBox="'
        f'{-size:.4g} {-size:.4g} {2 * size:.4g} {2 * size:.4g}">'
        f"<title>The head from above</title>{''.join(shapes)}</svg>"
    )
