"""A report of a found layout on one page: the requirements, the result, and its limits.

The page is one file that needs no network and prints on a sheet or two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import TYPE_CHECKING

from ..core.hues import chosen_hues
from .style import svg_text
from .wording import typeset

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ReportSection:
    """A part of the page: sentences, a table, a drawing (SVG or HTML), and unchanged text.

    wide: whether it spans both columns.
    """

    title: str
    words: Sequence[str] = ()
    headings: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = field(default_factory=list)
    drawing: str = ""
    text: str = ""
    wide: bool = False


def report(name: str, summary: str, sections: Sequence[ReportSection], origin: str) -> str:
    from jinja2 import Environment

    text = files("facets.pictures").joinpath("design_report.html").read_text("utf-8")
    places = Environment(autoescape=True)
    places.filters["typeset"] = typeset
    page = places.from_string(text)
    return page.render(
        name=name,
        summary=summary,
        sections=sections,
        origin=origin,
        hues=chosen_hues().css,
    )


def inline(picture: Figure, words: str) -> str:
    """Convert a picture to an SVG element of a page, whose text can be searched and read aloud."""
    from html import escape

    text = svg_text(picture)
    return text.replace("<svg", f'<svg role="img" aria-label="{escape(words)}"', 1)
