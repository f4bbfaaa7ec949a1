"""Materials of the parts, and the two themes of a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ...core.hues import DARK, LIGHT
from ...core.units import Floats

ThemeName = Literal["dark", "light"]


class Material(NamedTuple):
    """Parameters of a surface for physically based shading; numbers from 0 to 1.

    cut: colour of a cut face.  clear: transparency.  smooth: whether curved surfaces are shaded as
    smooth.  even: whether the surface has one colour without shading.  outlined: whether its rim is
    drawn.
    """

    colour: str
    metallic: float = 0.0
    roughness: float = 0.5
    cut: str = "#8C96A3"
    clear: float = 0.0
    smooth: bool = True
    even: bool = False
    outlined: bool = False


MATERIALS: dict[str, Material] = {
    "mirror": Material("#8E99A8", 1.0, 0.03, smooth=False),
    "steel": Material("#DDE1E6", 1.0, 0.28, "#9AA7B8"),
    "aluminium": Material("#E6E9ED", 1.0, 0.40, "#AEB8C4"),
    "plate": Material("#20252C", 0.4, 0.42, "#6F7B8B"),
    "anodised": Material("#121418", 0.3, 0.38, "#56606D"),
    "brass": Material("#F2C878", 1.0, 0.34, "#D8B068"),
    "gold": Material("#F0C35A", 1.0, 0.28, "#E8BE55"),
    "glass": Material("#6FA8C8", 0.0, 0.05, "#A9D3E8", clear=0.88),
    "silicon": Material("#070A18", 0.0, 0.5, "#4A58A8", smooth=False),
    "ceramic": Material("#E9E2D3", 0.0, 0.55, "#E3D9C6"),
    "board": Material("#0E4A2C", 0.0, 0.5, "#2E8B5C"),
    "plastic": Material("#17181B", 0.0, 0.45, "#3B4048"),
    "hole": Material("#020203", 0.0, 0.9, smooth=False),
    "face silicon": Material("#0B1026", even=True),
    "face ring": Material("#B08D3C", even=True),
    "face carrier": Material("#1A1D22", even=True),
}


@dataclass(frozen=True)
class Theme:
    """Colours and light of a picture.

    top, bottom: colours of the background.  ground: floor near the rig.  ink: letters and lines;
    faint: lines in insets; panel: ground of letters.  hues: facets, sub-beams and detectors A, B,
    C.  beam: beam before the mirror.  shines: whether light is added to the background, as in the
    dark, or blended as ink.  shadow: darkness of shadows, 0 to 1.  exposure: strength of the lamps.
    """

    top: str
    bottom: str
    ground: str
    ink: str
    faint: str
    panel: str
    hues: tuple[str, ...]
    beam: str
    shines: bool
    shadow: float
    exposure: float


THEMES: dict[ThemeName, Theme] = {
    "dark": Theme(
        "#10141B", "#1B222D", "#39424F", "#EEF2F7", "#8D99A9", "#141A23",
        tuple(DARK.detectors.values()), "#FFF3DC", True, 0.82, 1.0,
    ),
    "light": Theme(
        "#FFFFFF", "#F4F6F8", "#E6E9EC", "#1B2128", "#6B7682", "#FFFFFF",
        tuple(LIGHT.detectors.values()), "#6A7480", False, 0.55, 1.15,
    ),
}  # fmt: skip


def theme_of(style: str) -> ThemeName:
    """Return the theme that belongs to a style of the plots: paper, screen or dark."""
    return "dark" if style == "dark" else "light"


def rgb(colour: str) -> Floats:
    """Convert a colour "#RRGGBB" to numbers (3,) from 0 to 1."""
    return np.array([int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5)])
