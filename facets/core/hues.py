"""Hues of the detectors A, B and C, of the axes and of the background.

Plots, drawings, pages and the terminal use the same hues for a detector or an axis. A hue alone
never carries a meaning: axes also have a mark and a dash (`MARKS`, `DASHES`), detectors a letter.
Colour-blind readers can distinguish any two hues of a set (tests/pictures/test_hues.py simulates
this), and each hue has a contrast of at least 3 to 1 with its ground.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from .names import ANGLES, STATE


@dataclass(frozen=True)
class Hues:
    """A set of hues, each as "#RRGGBB".

    ground: background of a picture.  ink: text and true values.  soft: secondary text.  grey:
    secondary data.  rule: grids and thin lines.  detectors: by letter, a, b, c.  axes: by component
    of the state, Eq. (3).  series: other data, in this order.  alarm: warnings.
    """

    ground: str
    ink: str
    soft: str
    grey: str
    rule: str
    detectors: dict[str, str]
    axes: dict[str, str]
    series: tuple[str, ...]
    alarm: str

    @property
    def accent(self) -> str:
        """The most conspicuous hue, for data of neither a detector nor an axis."""
        return self.series[0]

    @property
    def css(self) -> str:
        """The hues as custom properties of a page: --ground, --ink, --a, --tx, --series-1 ..."""
        named = {name: getattr(self, name) for name in ("ground", "ink", "soft", "grey", "rule")}
        named |= {"alarm": self.alarm, **self.detectors, **self.axes}
        named |= {f"series-{n}": hue for n, hue in enumerate(self.series, start=1)}
        scheme = "light" if self.ground == "#FFFFFF" else "dark"
        text = ";".join(f"--{name}:{hue}" for name, hue in named.items())
        return f":root{{color-scheme:{scheme};{text}}}"


LIGHT = Hues(
    ground="#FFFFFF", ink="#1A1C20", soft="#5A5F69", grey="#8C9099", rule="#D9DCE1",
    detectors={"a": "#0072B2", "b": "#D55E00", "c": "#009E73"},
    axes={"tx": "#3B2E9E", "ty": "#B38600", "tz": "#B8256E",
          "roll": "#8577D6", "pitch": "#6B4700", "yaw": "#E0609B",
          "bx": "#5A1620", "by": "#8A8A4E"},
    series=("#1D3B70", "#C94F6D", "#B98A00", "#5B9BB5", "#6A1B3D"),
    alarm="#B3261E",
)  # fmt: skip
DARK = Hues(
    ground="#14171C", ink="#F1F3F5", soft="#B4BAC4", grey="#7D848F", rule="#343A44",
    detectors={"a": "#4DA9F0", "b": "#FF8A3D", "c": "#5FE0B0"},
    axes={"tx": "#9A8CFF", "ty": "#F0CF4F", "tz": "#FF7AB8",
          "roll": "#C9C2FF", "pitch": "#B8942F", "yaw": "#B54482",
          "bx": "#F5F5FF", "by": "#7F9A4A"},
    series=("#A9C4F5", "#EE6F8E", "#F2CC5C", "#5B7FC0", "#A04468"),
    alarm="#FF6B5E",
)  # fmt: skip
#: Hues by style. The styles for paper and screen differ in sizes and lines only.
THEMES = {"paper": LIGHT, "screen": LIGHT, "dark": DARK}

#: The default style of pictures.
STYLE = "screen"
_chosen: ContextVar[str] = ContextVar("style", default=STYLE)

#: Marks and dashes of the components of the state, as matplotlib names them.
MARKS = dict(zip(STATE, "osDPX^v<", strict=True))
DASHES = {name: "--" if name in ANGLES else ":" if name in STATE[6:] else "-" for name in STATE}


def choose_style(name: str) -> None:
    """Set the style of all later pictures: paper, screen or dark; `ValueError` for others."""
    if name not in THEMES:
        raise ValueError(f"no style {name}; allowed: {', '.join(THEMES)}")
    _chosen.set(name)


def chosen_style() -> str:
    return _chosen.get()


def chosen_hues() -> Hues:
    return THEMES[_chosen.get()]


@contextmanager
def use_style(name: str) -> Iterator[Hues]:
    """Context in which pictures have a style; yields its hues."""
    before = _chosen.get()
    choose_style(name)
    try:
        yield THEMES[name]
    finally:
        _chosen.set(before)
