"""A page on a result, such as a layout or a calibration, with sentences, tables and drawings.

The page is one file that needs no network and prints on a few sheets.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import TYPE_CHECKING

from ...core.hues import DARK, LIGHT, chosen_hues
from ..style import svg_text
from .wording import typeset

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ReportSection:
    """A section of the page: sentences, a table, a drawing (SVG or HTML), and preformatted text.

    wide: whether the section spans both columns.
    """

    title: str
    words: Sequence[str] = ()
    headings: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = field(default_factory=list)
    drawing: str = ""
    text: str = ""
    wide: bool = False


def report(
    title: str,
    summary: str,
    sections: Sequence[ReportSection],
    origin: str,
    warning: str = "",
    sheet: str = "",
) -> str:
    """Return a page as HTML, in light or dark hues as the reader chooses if it has no drawings.

    warning: text at the top, in the colour of alarms.  sheet: text at the foot of each printed
    sheet.
    """
    from jinja2 import Environment

    text = files(__package__).joinpath("report_page.html").read_text("utf-8")
    places = Environment(autoescape=True)
    places.filters["typeset"] = typeset
    has_drawing = any(section.drawing for section in sections)
    hues = chosen_hues().css if has_drawing else adaptive_hues()
    return places.from_string(text).render(
        title=title,
        summary=summary,
        sections=sections,
        origin=origin,
        warning=warning,
        sheet=re.sub(r"[^\w .,/·-]", " ", sheet),
        hues=hues,
    )


def adaptive_hues() -> str:
    """Return the colours of a page that follows its reader's choice of light or dark."""
    return (
        f"{chosen_hues().css}@media screen and (prefers-color-scheme:dark){{{DARK.css}}}"
        f"@media print{{{LIGHT.css}}}"
    )


def inline(picture: Figure, words: str) -> str:
    """Convert a picture to an SVG element of a page, whose text can be searched and read aloud."""
    from html import escape

    text = svg_text(picture)
    return text.replace("<svg", f'<svg role="img" aria-label="{escape(words)}"', 1)
