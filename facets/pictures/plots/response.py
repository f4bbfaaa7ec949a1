"""A picture of frequency responses: size, phase and coherence by axis, over the sensor's noise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.hues import chosen_hues
from ...core.names import ANGLES, POSE
from ...core.units import Booleans, Floats
from ...responses.frequency_response import FrequencyResponse, low_pass
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: The sensor's noise alone stays below this factor of its root mean square in 95 % of the lines.
NOISE_95 = float(np.sqrt(-np.log(0.05)))
#: Lines above this number are drawn as pixels in vector formats.
VECTOR_LINES = 4000
#: Height of the panels of size, phase and coherence.
HEIGHTS = (3.0, 1.0, 1.0)


def response_picture(
    response: FrequencyResponse, unit: str, title: str, bandwidth: float
) -> Figure:
    """Draw the responses of the six axes; shifts left, angles right.

    unit: of the input.  bandwidth: of the electronics, Hz.
    """
    with style.style_context():
        picture = style.figure(style.FULL, 10.2)
        picture.suptitle(title, x=0.01, ha="left")
        cells = picture.add_gridspec(3, 2)
        groups = ([n for n in POSE if n not in ANGLES], list(ANGLES))
        for column, names in enumerate(groups):
            for row, name in enumerate(names):
                inner = cells[row, column].subgridspec(3, 1, height_ratios=HEIGHTS, hspace=0.0)
                panels: Any = inner.subplots(sharex=True)
                draw_axis(panels, response, name, unit, bandwidth)
                if row < 2:
                    panels[2].tick_params(labelbottom=False)
                else:
                    panels[2].set_xlabel("frequency, Hz")
        legend(picture, response, bandwidth)
    return picture


def draw_axis(
    panels: Any, response: FrequencyResponse, name: str, unit: str, bandwidth: float
) -> None:
    """Draw size, phase and coherence of one axis in three panels."""
    n, hues, form = POSE.index(name), chosen_hues(), response.form
    frequency, hue, scale = response.frequency, chosen_hues().axes[name], form.factor(name)
    size = scale * np.abs(response.h1[:, n])
    half = response.coverage_factor * response.random_error[:, n]
    is_seen = response.coherence[:, n] > response.significant_coherence
    flat = len(frequency) > VECTOR_LINES
    floor = NOISE_95 ** (-1 if form.is_inverse else 1) * scale * response.noise_floor[:, n]
    sizes, phases, coherences = panels
    known = frequency[response.is_excited]
    shown = max(frequency[0], 0.7 * known.min()), min(frequency[-1], 1.3 * known.max())
    sizes.set(yscale="log", xscale="log", title=style.component_label(name))
    least = 0.2 * float(
        np.nanmin(
            [
                np.median(floor[response.is_excited]),
                size[is_seen].min(initial=np.inf),
                np.median(size),
            ]
        )
    )
    top = 2 * float(np.nanmax(size[response.is_excited]))
    sizes.fill_between(
        frequency, top if form.is_inverse else least, floor, color=hues.grey, alpha=0.45, lw=0
    )
    sizes.fill_between(frequency, size * np.maximum(1 - half, 1e-3), size * (1 + half),
                       color=hue, alpha=0.25, lw=0, where=is_seen, rasterized=flat)  # fmt: skip
    h2 = scale * np.abs(response.h2[:, n])
    sizes.plot(frequency, keep(h2, is_seen), color=hues.ink, lw=0.5, rasterized=flat)
    sizes.plot(frequency, size, color=hues.grey, lw=0.5, rasterized=flat)
    sizes.plot(frequency, keep(size, is_seen), color=hue, rasterized=flat)
    if top > 0:  # an axis that is zero in all rows has no size to show
        sizes.set_ylim(least, top)
    sizes.set_ylabel(f"{'1/' if form.is_inverse else ''}|H|, {form.unit_text(name, unit)}")
    angle = np.degrees(np.angle(response.h1[:, n]))
    phases.plot(frequency, keep(angle, is_seen), ".", ms=1.2, color=hue, rasterized=flat)
    phases.set(ylim=(-200, 200), yticks=(-180, 0, 180), ylabel="phase, °")
    lag = np.degrees(np.angle(low_pass(frequency, bandwidth)))
    phases.plot(frequency, -lag if form.is_inverse else lag, "--", color=hues.alarm, lw=1.0)
    if bandwidth < frequency[-1]:
        sizes.axvline(bandwidth, color=hues.alarm, ls="--", lw=1.0)
    coherences.plot(frequency, response.coherence[:, n], color=hue, lw=0.7, rasterized=flat)
    if response.multiple_coherence is not None:
        coherences.plot(frequency, response.multiple_coherence[:, n], color=hues.ink, lw=0.5)
    coherences.axhline(response.significant_coherence, color=hues.grey, lw=0.8)
    coherences.set(ylim=(0, 1.05), yticks=(0, 0.5), ylabel="coher.")
    for panel in panels:
        panel.set_xlim(*shown)
        shade(panel, frequency, ~response.is_excited)


def keep(values: Floats, chosen: Booleans) -> Floats:
    """The chosen values, NaN elsewhere."""
    return np.where(chosen, values, np.nan)


def shade(panel: Axes, frequency: Floats, dark: Booleans) -> None:
    """Hatch the bands where the input has no power."""
    panel.fill_between(frequency, 0, 1, where=dark, transform=panel.get_xaxis_transform(),
                       facecolor="none", edgecolor=chosen_hues().rule, hatch="////",
                       lw=0)  # fmt: skip


def legend(picture: Figure, response: FrequencyResponse, bandwidth: float) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    hues = chosen_hues()
    handles: list[Any] = [
        Line2D([], [], color=hues.axes["tx"]),
        Patch(color=hues.axes["tx"], alpha=0.25),
        Line2D([], [], color=hues.ink, lw=0.5),
        Line2D([], [], color=hues.grey, lw=0.8),
    ]
    texts = ["H1", "its 95 % random error", "H2", "H1, and coherence, as large as by chance"]
    if np.isfinite(response.noise_density).any():
        handles.append(Patch(color=hues.grey, alpha=0.45))
        texts.append("the sensor's noise alone (95 %)")
    if response.multiple_coherence is not None:
        handles.append(Line2D([], [], color=hues.ink, lw=0.5))
        texts.append("coherence with all inputs (multiple)")
    if not response.is_excited.all():
        handles.append(Patch(facecolor="none", edgecolor=hues.rule, hatch="////"))
        texts.append("hardly any input")
    handles.append(Line2D([], [], color=hues.alarm, ls="--", lw=1.0))
    texts.append(f"low pass of the electronics, {bandwidth:.4g} Hz")
    style.legend_below(picture, handles, texts, 2)
