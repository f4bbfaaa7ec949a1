"""The picture of a simulated motion: true and estimated poses, and the error in a strip below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.hues import chosen_hues
from ...core.names import ANGLES, POSE
from ...core.units import Floats
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...simulation.run import Segment

#: Inches: the picture's height; margins left, right, above, below; gaps between columns and rows.
HEIGHT, MARGINS, BETWEEN = 7.8, (0.78, 0.08, 0.12, 1.12), (0.84, 0.26)
#: Relative heights of a panel and of the strip of its error below.
SHARES = (1.45, 1.0)
#: Distance of labels from a panel, inches to its left.
LABEL = 0.58
#: Dash and gap of the line at twice the standard uncertainty, points.
DASHES = (0, (4, 2))
#: Number of columns of a panel into which many samples are gathered.
COLUMNS = 160


def motion_picture(segments: Sequence[Segment]) -> Figure:
    """Draw six axes: shifts left, angles right; one motion after the other, all equally wide."""
    with style.style_context():
        picture, panels = panels_of_axes()
        clock = Clock(segments)
        for n in range(len(POSE)):
            column, row = divmod(n, 3)
            place, error = panels[row, column]
            place_panel(place, clock, segments, n)
            error_panel(error, clock, segments, n)
            clock.mark(place, error, lowest=row == 2)
        legend(picture, clock, has_unsolved(segments))
    return picture


def panels_of_axes() -> tuple[Figure, NDArray[Any]]:
    """Make the picture and its panels (3, 2, 2): row, column, and place or error.

    They have fixed places, because measuring all their labels takes as long as drawing them.
    """
    left, right, above, below = MARGINS
    picture = style.figure(style.FULL, HEIGHT, layout="none")
    wide = (style.FULL - left - right - BETWEEN[0]) / 2
    tall = (HEIGHT - above - below - 2 * BETWEEN[1]) / 3
    panels = np.empty((3, 2, 2), dtype=object)
    for row in range(3):
        for column in range(2):
            x = (left + column * (wide + BETWEEN[0])) / style.FULL
            top = HEIGHT - above - row * (tall + BETWEEN[1])
            high = tall * SHARES[0] / sum(SHARES)
            rest = tall - high - 0.06
            place = picture.add_axes((x, (top - high) / HEIGHT, wide / style.FULL, high / HEIGHT))
            panels[row, column] = (
                place,
                picture.add_axes(
                    (x, (top - tall) / HEIGHT, wide / style.FULL, rest / HEIGHT), sharex=place
                ),
            )
    for panel in panels.ravel():
        panel.yaxis.set_label_coords(-LABEL / wide, 0.5)
    return picture, panels


class Clock:
    """The samples' places on the time axis: times of one motion, or unit lengths for several."""

    def __init__(self, segments: Sequence[Segment]) -> None:
        self.names = [segment.name for segment in segments]
        self.seconds = [float(np.ptp(s.time)) + step_of(s.time) for s in segments]
        self.alone = len(segments) == 1
        self.times = [
            segment.time - segment.time[0]
            if self.alone
            else n + 0.04 + 0.92 * (segment.time - segment.time[0]) / seconds
            for n, (segment, seconds) in enumerate(zip(segments, self.seconds, strict=True))
        ]

    def mark(self, place: Axes, error: Axes, lowest: bool) -> None:
        place.tick_params(labelbottom=False)
        error.tick_params(labelbottom=lowest)
        if self.alone:
            reach = self.seconds[0]
            error.set_xlim(-0.03 * reach, 1.03 * reach)
            error.set_xlabel("time, s" if lowest else "")
            return
        count = len(self.names)
        for panel in (place, error):
            panel.grid(visible=False, axis="x")
            for n in range(1, count):
                panel.axvline(n, color=chosen_hues().grey, lw=0.7, zorder=0)
        error.set_xlim(0, count)
        error.set_xticks(np.arange(count) + 0.5, [str(n + 1) for n in range(count)])
        error.tick_params(axis="x", length=0)

    @property
    def words(self) -> str:
        """Name the motions for the label below the panels."""
        named = [
            f"{n} {name} ({seconds:.3g} s)"
            for n, (name, seconds) in enumerate(zip(self.names, self.seconds, strict=True), start=1)
        ]
        return ", ".join(named)


def step_of(time: NDArray[np.float64]) -> float:
    return float(time[1] - time[0]) if len(time) > 1 else 1.0


def has_unsolved(segments: Sequence[Segment]) -> bool:
    return any(not segment.solution.converged.all() for segment in segments)


def columns_for(segments: Sequence[Any]) -> int:
    return max(12, COLUMNS // len(segments))


def place_panel(panel: Axes, clock: Clock, segments: Sequence[Segment], n: int) -> None:
    """Draw the truth as a broad line, and the estimate thin upon it, so that both are visible."""
    hues, name = chosen_hues(), POSE[n]
    moved = any(np.ptp(segment.truth[:, n]) > 0 for segment in segments)
    unit = style.unit_of(name)
    factor = unit.factor if moved else unit.fine_factor
    for segment, time in zip(segments, clock.times, strict=True):
        truth = factor * segment.truth[:, n]
        width = {"marker": "s", "ms": 7} if len(time) == 1 else {"lw": 4.2}
        panel.plot(time, truth, color=hues.grey, alpha=0.55, solid_capstyle="butt", **width)
        samples(panel, time, factor * segment.solution.state[:, n], name, columns_for(segments))
        mark_failures(panel, time[~segment.solution.converged])
    panel.set_ylabel(style.place_label(name) if moved else style.fine_label(name))
    panel.margins(y=0.12)


def samples(panel: Axes, time: Floats, values: Floats, name: str, columns: int) -> None:
    """Draw few samples as marks; many as the band from least to largest, with their median."""
    hue = chosen_hues().axes[name]
    if len(time) <= columns:
        panel.plot(time, values, ".", ms=6 if len(time) < 10 else 3, color=hue, mew=0)
        return
    band = style.band(time, values, columns)
    panel.fill_between(band.time, band.low, band.high, color=hue, alpha=0.4, lw=0)
    panel.plot(band.time, band.middle, color=hue, lw=1.0)


def mark_failures(panel: Axes, time: Floats) -> None:
    """Mark samples that could not be solved, along the foot of a panel."""
    panel.plot(time, np.full(len(time), 0.03), "|", ms=5, color=chosen_hues().alarm,
               transform=panel.get_xaxis_transform(), clip_on=False)  # fmt: skip


def error_panel(panel: Axes, clock: Clock, segments: Sequence[Segment], n: int) -> None:
    """Draw the error and the band of twice its standard uncertainty."""
    hues, name = chosen_hues(), POSE[n]
    unit = style.unit_of(name)
    for segment, time in zip(segments, clock.times, strict=True):
        wide = 2 * unit.fine_factor * segment.solution.uncertainty[:, n]
        band = style.band(time, wide, columns_for(segments))
        for side in (-1, 1):
            panel.plot(band.time, side * band.middle, color=hues.ink, lw=0.8, ls=DASHES)
        if len(time) == 1:
            panel.errorbar(time, 0 * time, wide, color=hues.ink, lw=0.8, capsize=3, fmt="none")
        samples(panel, time, unit.fine_factor * segment.error[:, n], name, columns_for(segments))
    if not any(segment.solution.converged.any() for segment in segments):
        style.say(panel, "no sample could be solved")
    panel.axhline(0, color=hues.soft, lw=0.6, zorder=0)
    panel.set_ylabel(f"error, {unit.fine_unit}")
    panel.margins(y=0.12)


def legend(picture: Figure, clock: Clock, with_unsolved: bool) -> None:
    """Explain lines and bands, and name the motions."""
    from textwrap import fill

    from matplotlib.legend_handler import HandlerTuple
    from matplotlib.lines import Line2D

    hues = chosen_hues()
    names = [name for name in POSE if name not in ANGLES]
    handles: list[Any] = [
        Line2D([], [], color=hues.grey, alpha=0.55, lw=4.2),
        tuple(Line2D([], [], color=hues.axes[name], lw=1.6) for name in names),
        Line2D([], [], color=hues.ink, lw=0.8, ls=DASHES),
    ]
    texts = ["truth", "estimate, error", "± 2 standard uncertainties"]
    if with_unsolved:
        handles.append(Line2D([], [], color=hues.alarm, marker="|", ls=""))
        texts.append("not solved")
    top = 0.62 / HEIGHT
    picture.legend(handles, texts, loc="center", bbox_to_anchor=(0.5, top), ncols=4,
                   columnspacing=1.2, handletextpad=0.5,
                   handler_map={tuple: HandlerTuple(ndivide=None, pad=0)})  # fmt: skip
    words = clock.names[0] if clock.alone else f"motions: {clock.words}"
    if any(len(time) > columns_for(clock.times) for time in clock.times):
        words += (
            "; bands from the least to the largest of neighbouring samples, lines at their median"
        )
    picture.text(0.5, 0.46 / HEIGHT, fill(words, 88), ha="center", va="top",
                 fontsize=style.LEAST, color=hues.soft, linespacing=1.25)  # fmt: skip
