"""One page on a layout that was found: what was asked, what was found, and how far to believe it.

The page is one file that asks nothing of a network and prints on a sheet or two.
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
    """A part of the page: sentences, a table, a drawing (SVG or HTML), and text as it is.

    wide: over both columns.
    """

    title: str
    words: Sequence[str] = ()
    headings: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = field(default_factory=list)
    drawing: str = ""
    text: str = ""
    wide: bool = False


def report(name: str, summary: str, sections: Sequence[ReportSection], origin: str) -> str:
    """The page as HTML."""
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
    """A picture as an element of a page: SVG, whose text can be searched and read aloud."""
    from html import escape

    text = svg_text(picture)
    return text.replace("<svg", f'<svg role="img" aria-label="{escape(words)}"', 1)
