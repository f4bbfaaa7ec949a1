"""Materials of the parts, and the two themes of a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from ...core.hues import DARK, LIGHT

ThemeName = Literal["dark", "light"]


class Material(NamedTuple):
    """A surface's parameters for physically based shading: colour, and shares from 0 to 1.

    clear: transparency.  smooth: whether curved surfaces are shaded as smooth.
    """

    colour: str
    metallic: float
    roughness: float
    clear: float = 0.0
    smooth: bool = True


MATERIALS: dict[str, Material] = {
    "mirror": Material("#8E99A8", 1.0, 0.03, smooth=False),
    "steel": Material("#DDE1E6", 1.0, 0.28),
    "aluminium": Material("#E6E9ED", 1.0, 0.40),
    "plate": Material("#20252C", 0.4, 0.42),
    "anodised": Material("#121418", 0.3, 0.38),
    "brass": Material("#F2C878", 1.0, 0.34),
    "gold": Material("#F0C35A", 1.0, 0.28),
    "glass": Material("#6FA8C8", 0.0, 0.05, clear=0.88),
    "silicon": Material("#070A18", 0.0, 0.5, smooth=False),
    "ceramic": Material("#E9E2D3", 0.0, 0.55),
    "board": Material("#0E4A2C", 0.0, 0.5),
    "plastic": Material("#17181B", 0.0, 0.45),
    "hole": Material("#020203", 0.0, 0.9, smooth=False),
}


#: Colours of cut faces.
CUTS = {"steel": "#9AA7B8", "aluminium": "#AEB8C4", "plate": "#6F7B8B", "anodised": "#56606D",
        "brass": "#D8B068", "gold": "#E8BE55", "glass": "#A9D3E8", "silicon": "#4A58A8",
        "ceramic": "#E3D9C6", "board": "#2E8B5C", "plastic": "#3B4048"}  # fmt: skip


@dataclass(frozen=True)
class Theme:
    """Colours of a picture.

    top, bottom: of the background.  ground: of the floor near the rig.  ink: of letters and lines,
    faint: of lesser ones.  hues: of facets, sub-beams and detectors A, B, C.  beam: of the light
    before it is shared.  shines: whether light is added to the background, as in the dark; else it
    is blended as ink.  shadow: darkness of shadows, 0 to 1.
    """

    name: str
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

    def cut(self, material: str) -> str:
        """Return the colour of a material's cut face."""
        return CUTS.get(material, "#8C96A3")


THEMES: dict[str, Theme] = {
    "dark": Theme(
        "dark", "#10141B", "#1B222D", "#39424F", "#EEF2F7", "#8D99A9", "#141A23",
        tuple(DARK.detectors.values()), "#FFF3DC", True, 0.82, 1.0,
    ),
    "light": Theme(
        "light", "#FFFFFF", "#F4F6F8", "#E6E9EC", "#1B2128", "#6B7682", "#FFFFFF",
        tuple(LIGHT.detectors.values()), "#6A7480", False, 0.55, 1.15,
    ),
}  # fmt: skip


def theme_of(style: str) -> ThemeName:
    """Return the theme for a style of the plots: paper, screen or dark."""
    return "dark" if style == "dark" else "light"


def rgb(colour: str) -> tuple[float, float, float]:
    """Convert a colour "#RRGGBB" to shares."""
    red, green, blue = (int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5))
    return red, green, blue
