"""Plots: one style for the whole project, and the picture of a simulated motion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.names import POSE
from ..core.units import unit_of as unit_of
from ..files.tables import Whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..simulation.run import Segment

#: Okabe and Ito's colours, told apart also by the colour-blind.
INK, BLUE, ORANGE, GREEN, GREY = "#222222", "#0072B2", "#D55E00", "#009E73", "#999999"
#: For many series, in this order.
SERIES = (BLUE, ORANGE, GREEN, "#CC79A7", "#E69F00", "#56B4E9", GREY)
STYLE: dict[Any, Any] = {
    "axes.edgecolor": INK,
    "axes.grid": True,
    "axes.labelsize": 9,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "figure.facecolor": "white",
    "font.size": 9,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "savefig.dpi": 150,
    "svg.hashsalt": "facets",
}
ENDINGS = (".png", ".svg", ".pdf")
#: What SVG and PDF count in: points.
VECTOR_DPI = 72
#: Margins of a page of panels one above the other, inches: left, right, above, below, and between.
MARGINS = (0.95, 0.1, 0.55, 0.85, 0.95)
#: Where a panel's label stands, in widths of the panel.
LABEL = -0.155


def figure(width: float, height: float, **options: Any) -> Figure:
    """An empty figure in the project's style, inches."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        return Figure(figsize=(width, height), **{"layout": "constrained", **options})


def save(picture: Figure, path: Path) -> None:
    """Writes the picture whole or not at all; PNG, SVG or PDF by its ending."""
    import matplotlib as mpl

    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: a picture's name ends in {', '.join(ENDINGS)}")
    kind = path.suffix[1:].lower()
    with mpl.rc_context(STYLE), Whole(path) as temporary:
        lay_out(picture, STYLE["savefig.dpi"] if kind == "png" else VECTOR_DPI)
        picture.savefig(temporary, format=kind, dpi="figure")


def lay_out(picture: Figure, dpi: int) -> None:
    """Puts the parts of a picture where its layout has them, once.

    Saving would do so and draw the picture to nowhere first, which takes as long as drawing it.
    """
    picture.set_dpi(dpi)
    layout = picture.get_layout_engine()
    if layout is not None:
        layout.execute(picture)
        picture.set_layout_engine("none")


def motion_picture(segments: Sequence[Segment]) -> Figure:
    """Truth and estimate (left) and error (right) of six axes, one motion after the other."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        picture, panels = page_of_panels(10, 11, 6)
        clock = Clock(segments)
        for i, name in enumerate(POSE):
            place_panel(panels[i, 0], clock, segments, i, name)
            error_panel(panels[i, 1], clock, segments, i, name)
        for column, title in enumerate(("true motion and estimate", "error of the estimate")):
            panels[0, column].set_title(title, pad=22)
            panels[5, column].set_xlabel("time, one motion after the other, s")
            clock.mark(panels[:, column])
        parts = [panels[0, column].get_legend_handles_labels() for column in (0, 1)]
        handles, texts = (a + b for a, b in zip(*parts, strict=True))
        picture.legend(handles, texts, loc="lower center", ncols=4, markerscale=4)
    return picture


def page_of_panels(width: float, height: float, rows: int) -> tuple[Figure, NDArray[Any]]:
    """A picture of two columns of panels at fixed places, inches, and the panels.

    Their labels are alike from one to the next, so that nothing has to be measured: measuring all
    of them takes as long as drawing them.
    """
    left, right, above, below, between = MARGINS
    picture = figure(width, height, layout="none")
    across = (width - left - right - between) / 2
    places = {"left": left / width, "right": 1 - right / width, "top": 1 - above / height,
              "bottom": below / height, "wspace": between / across, "hspace": 0.12}  # fmt: skip
    return picture, picture.subplots(rows, 2, sharex=True, gridspec_kw=places)


class Clock:
    """Puts the motions one after the other on a common time axis."""

    def __init__(self, segments: Sequence[Segment]) -> None:
        self.names = [segment.name for segment in segments]
        lengths = [float(np.ptp(s.time)) + step_of(s.time) for s in segments]
        self.starts = np.concatenate([[0.0], np.cumsum(lengths)])
        self.short = any(len(segment.time) == 1 for segment in segments)
        self.times = [
            segment.time - segment.time[0] + start
            for segment, start in zip(segments, self.starts, strict=False)
        ]

    def mark(self, panels: NDArray[Any]) -> None:
        for panel in panels:
            if self.short:  # a single sample has no width of its own for a name to stand over
                panel.set_xlim(self.starts[0] - 0.1, self.starts[-1] + 0.1)
            for start in self.starts[1:-1]:
                panel.axvline(start, color=GREY, lw=0.8, ls=":")
        for name, start, end in zip(self.names, self.starts[:-1], self.starts[1:], strict=True):
            panels[0].annotate(
                name, ((start + end) / 2, 1.04), xycoords=("data", "axes fraction"),
                ha="center", fontsize=8, color=GREY, annotation_clip=False,
            )  # fmt: skip


def step_of(time: NDArray[np.float64]) -> float:
    return float(time[1] - time[0]) if len(time) > 1 else 1.0


def place_panel(panel: Axes, clock: Clock, segments: Sequence[Segment], i: int, name: str) -> None:
    unit, factor, _, _ = unit_of(name)
    for n, segment in enumerate(segments):
        labels = ("truth", "estimate") if n == 0 else (None, None)
        time = clock.times[n]
        panel.plot(time, factor * segment.truth[:, i], color=INK, lw=0.8, zorder=3, label=labels[0])
        estimate = factor * segment.solution.state[:, i]
        panel.plot(time, estimate, ".", ms=1.5, color=BLUE, label=labels[1], rasterized=True)
    label(panel, f"{name}, {unit}")


def label(panel: Axes, text: str) -> None:
    """Names what a panel shows, at a fixed place beside it: one below the other, not measured."""
    panel.set_ylabel(text)
    panel.yaxis.set_label_coords(LABEL, 0.5)


def error_panel(panel: Axes, clock: Clock, segments: Sequence[Segment], i: int, name: str) -> None:
    _, _, unit, factor = unit_of(name)
    for n, segment in enumerate(segments):
        labels = ("error", "± 2 standard uncertainties") if n == 0 else (None, None)
        time, band = clock.times[n], 2 * factor * segment.solution.uncertainty[:, i]
        panel.fill_between(time, -band, band, color=ORANGE, alpha=0.25, lw=0, label=labels[1])
        error = factor * segment.error[:, i]
        panel.plot(time, error, ".", ms=1.5, color=BLUE, label=labels[0], rasterized=True)
    label(panel, f"error of {name}, {unit}")
