"""The picture of a simulated motion: true and estimated poses, with their errors below."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.hues import chosen_hues
from ...core.names import POSE
from ...core.units import Floats, unit_of
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...simulation.run import Segment

#: Relative heights of the panels of an axis and of its error.
HEIGHTS = (1.45, 1.0)
#: Dash and gap of the line at twice the standard uncertainty, points.
DASHES = (0, (4, 2))
#: Number of columns in a panel, each of which shows many samples as a band.
COLUMNS = 160


def motion_picture(segments: Sequence[Segment]) -> Figure:
    """Draw six axes, shifts on the left and angles on the right, with errors on common scales.

    Several motions follow one another and have equal widths.
    """
    clock, count = Clock(segments), max(12, COLUMNS // len(segments))
    with style.style_context():
        picture = style.figure(style.FULL, 7.8)
        panels: Any = picture.subplots(6, 2, sharex=True, height_ratios=3 * HEIGHTS)
        for n, name in enumerate(POSE):
            column, row = divmod(n, 3)
            place, error = panels[2 * row : 2 * row + 2, column]
            if row:
                error.sharey(panels[1, column])
            draw_places(place, clock, segments, name, count)
            draw_errors(error, clock, segments, name, count)
            for panel in (place, error):
                clock.mark(panel)
                panel.locator_params(axis="y", nbins=4)
        for panel in panels[-1]:
            panel.set_xlabel(clock.label)
        picture.align_ylabels()
        words = clock.words
        if any(len(time) > count for time in clock.times):
            words += "; bands from the minimum to the maximum of neighbouring samples, "
            words += "lines at their median"
        legend = style.panels_legend(picture, panels.ravel(), 4)
        legend.set_title(fill(words, 84), {"size": style.LEAST})
        legend.get_title().set_color(chosen_hues().soft)
    return picture


class Clock:
    """The time axis: seconds of one motion, or unit lengths of several ones."""

    def __init__(self, segments: Sequence[Segment]) -> None:
        self.names = [segment.name for segment in segments]
        self.seconds = [float(np.ptp(s.time)) + step_of(s.time) for s in segments]
        self.is_single = len(segments) == 1
        self.label = "time, s" if self.is_single else ""
        self.times = [
            segment.time - segment.time[0]
            if self.is_single
            else n + 0.04 + 0.92 * (segment.time - segment.time[0]) / seconds
            for n, (segment, seconds) in enumerate(zip(segments, self.seconds, strict=True))
        ]

    def mark(self, panel: Axes) -> None:
        """Set the limits and ticks of a panel's time axis."""
        if self.is_single:
            reach = self.seconds[0]
            panel.set_xlim(-0.03 * reach, 1.03 * reach)
            return
        count = len(self.names)
        panel.grid(visible=False, axis="x")
        for n in range(1, count):
            panel.axvline(n, color=chosen_hues().grey, lw=0.7, zorder=0)
        panel.set_xlim(0, count)
        panel.set_xticks(np.arange(count) + 0.5, [str(n + 1) for n in range(count)])
        panel.tick_params(axis="x", length=0)

    @property
    def words(self) -> str:
        """Names of the motions for the legend."""
        if self.is_single:
            return self.names[0]
        named = [
            f"{n} {name} ({seconds:.3g} s)"
            for n, (name, seconds) in enumerate(zip(self.names, self.seconds, strict=True), start=1)
        ]
        return "motions: " + ", ".join(named)


def step_of(time: Floats) -> float:
    return float(time[1] - time[0]) if len(time) > 1 else 1.0


def draw_places(
    panel: Axes, clock: Clock, segments: Sequence[Segment], name: str, count: int
) -> None:  # fmt: skip
    """Draw the truth as a broad line and the estimate as a thin one on it."""
    hues, n = chosen_hues(), POSE.index(name)
    moved = any(np.ptp(segment.truth[:, n]) > 0 for segment in segments)
    unit = unit_of(name)
    factor = unit.factor if moved else unit.fine_factor
    for segment, time in zip(segments, clock.times, strict=True):
        width = {"marker": "s", "ms": 7} if len(time) == 1 else {"lw": 4.2}
        panel.plot(time, factor * segment.truth[:, n], color=hues.grey, alpha=0.55,
                   solid_capstyle="butt", label="truth", **width)  # fmt: skip
        draw_samples(panel, time, factor * segment.solution.state[:, n], name, count)
        lost = time[~segment.solution.converged]
        if len(lost):  # along the lower edge of the panel
            panel.plot(lost, np.full(len(lost), 0.03), "|", ms=5, color=hues.alarm, clip_on=False,
                       transform=panel.get_xaxis_transform(), label="not solved")  # fmt: skip
    panel.set_ylabel(style.place_label(name) if moved else style.fine_label(name))
    panel.margins(y=0.12)


def draw_samples(panel: Axes, time: Floats, values: Floats, name: str, count: int) -> None:
    """Draw few samples as marks, and many as a band from minimum to maximum with the median."""
    hue, words = chosen_hues().axes[name], "estimate, error"
    if len(time) <= count:
        size = 6 if len(time) < 10 else 3
        panel.plot(time, values, ".", ms=size, color=hue, mew=0, label=words)
        return
    band = style.band(time, values, count)
    panel.fill_between(band.time, band.low, band.high, color=hue, alpha=0.4, lw=0)
    panel.plot(band.time, band.middle, color=hue, lw=1.0, label=words)


def draw_errors(
    panel: Axes, clock: Clock, segments: Sequence[Segment], name: str, count: int
) -> None:  # fmt: skip
    """Draw the error and the band of twice its standard uncertainty."""
    hues, unit, n = chosen_hues(), unit_of(name), POSE.index(name)
    for segment, time in zip(segments, clock.times, strict=True):
        wide = 2 * unit.fine_factor * segment.solution.uncertainty[:, n]
        band = style.band(time, wide, count)
        for side in (-1, 1):
            panel.plot(band.time, side * band.middle, color=hues.ink, lw=0.8, ls=DASHES,
                       label="± 2 standard uncertainties")  # fmt: skip
        if len(time) == 1:
            panel.errorbar(time, 0 * time, wide, color=hues.ink, lw=0.8, capsize=3, fmt="none")
        draw_samples(panel, time, unit.fine_factor * segment.error[:, n], name, count)
    if not any(segment.solution.converged.any() for segment in segments):
        style.say(panel, "no sample could be solved")
    panel.axhline(0, color=hues.soft, lw=0.6, zorder=0)
    panel.set_ylabel(f"error, {unit.fine_unit}")
    panel.margins(y=0.12)
