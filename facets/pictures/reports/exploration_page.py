"""A page of designs: scatter matrix, parallel coordinates, and a drawing of each design.

The page is one file that needs no network; plotly draws its plots.
"""

from __future__ import annotations

import html
import json
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.extras import require_extra
from ...core.sensor import Sensor
from .head_drawing import drawing
from .report_page import adaptive_hues
from .wording import label, limit_in_words, lines_of

#: Maximum number of columns in the plots.
MAX_PLOTTED = 9


def plotly_text() -> str:
    """Return plotly's JavaScript. Raises `InputError` if plotly is not installed."""
    return str(require_extra("plotly.offline", "--report").get_plotlyjs())


@dataclass(frozen=True)
class ShownDesigns:
    """The designs of a page, each with its sensor and its YAML.

    table: columns of variables, objectives and other measures, and `kind` ("own", "front" or
    "other"), `title` and `remark` of each design.
    """

    table: dict[str, NDArray[Any]]
    sensors: list[Sensor]
    texts: list[str]


def page(
    name: str, variables: list[str], objectives: list[str], designs: ShownDesigns, summary: str
) -> str:
    """Return the page of a design space as HTML.

    name: of the configuration.  variables, objectives: columns of `ShownDesigns.table`.
    """
    table = designs.table
    measures = [key for key, values in table.items() if values.dtype.kind == "f"]
    plotted = [*objectives, *variables][:MAX_PLOTTED]
    columns = [
        {
            "label": label(key),
            "lines": lines_of(label(key)),
            "values": round_digits(table[key]),
            "plotted": key in plotted,
            "listed": key in plotted,
        }
        for key in sorted(measures, key=lambda key: (key not in plotted, order(key, plotted)))
    ]
    kinds = table["kind"].tolist()
    data = {
        "kind": kinds,
        "title": table["title"].tolist(),
        "remark": [remark_in_words(remark) for remark in table["remark"].tolist()],
        "columns": columns,
        "yaml": designs.texts,
        "drawing": [drawing(sensor) for sensor in designs.sensors],
        "first": kinds.index("front") if "front" in kinds else 0,
    }
    goals = [label(key).partition(", ")[0] for key in objectives]
    text = files(__package__).joinpath("exploration_page.html").read_text("utf-8")
    # a script must not contain its own end tag
    content = json.dumps(data, ensure_ascii=False, allow_nan=False).replace("</", "<\\/")
    for mark, value in (
        ("NAME", html.escape(name)), ("OBJECTIVES", html.escape(", ".join(goals))),
        ("SUMMARY", html.escape(summary)), ("HUES", adaptive_hues()),
    ):  # fmt: skip
        text = text.replace(mark, value)
    before, after = text.split("PLOTLY", 1)
    start, end = after.split("= DATA;", 1)
    return f"{before}{plotly_text()}{start}= {content};{end}"


def remark_in_words(remark: str) -> str:
    """Write the limits of a design in words; they are given as "radius_mm at its most (1); ..."."""
    parts = [part.rpartition(" (") for part in remark.split("; ")] if remark else []
    return ", ".join(f"{limit_in_words(group)} ({size}" for group, _, size in parts)


def order(key: str, plotted: list[str]) -> int:
    return plotted.index(key) if key in plotted else 0


def round_digits(values: NDArray[Any]) -> list[float | None]:
    """Round to seven digits; None for a missing number."""
    return [float(f"{v:.7g}") if np.isfinite(v) else None for v in values.tolist()]
