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

#: Factor of its root mean square below which the sensor's noise stays in 95 % of the lines.
NOISE_95 = float(np.sqrt(-np.log(0.05)))
NOISE_LABEL = "sensor's noise alone (95 %)"
#: Number of spectral lines above which they are drawn as pixels in vector formats.
VECTOR_LINES = 4000
#: Height of the panels of size, phase and coherence.
HEIGHTS = (3.0, 1.0, 1.0)


def response_picture(
    response: FrequencyResponse, unit: str, title: str, bandwidth: float
) -> Figure:
    """Draw the responses of the six axes, shifts on the left and angles on the right.

    unit: unit of the input.  bandwidth: bandwidth of the electronics, Hz.
    """
    with style.style_context():
        picture = style.figure(style.FULL, 10.2)
        picture.suptitle(title, x=0.01, ha="left")
        cells = picture.add_gridspec(3, 2)
        groups, labelled = ([n for n in POSE if n not in ANGLES], list(ANGLES)), []
        for column, names in enumerate(groups):
            for row, name in enumerate(names):
                inner = cells[row, column].subgridspec(3, 1, height_ratios=HEIGHTS, hspace=0.0)
                panels: Any = inner.subplots(sharex=True)
                draw_axis(panels, response, name, unit, bandwidth)
                labelled += list(panels)
                if row < 2:
                    panels[2].tick_params(labelbottom=False)
                else:
                    panels[2].set_xlabel("frequency, Hz")
        style.panels_legend(picture, labelled, 2)
    return picture


def draw_axis(
    panels: Any, response: FrequencyResponse, name: str, unit: str, bandwidth: float
) -> None:
    """Draw size, phase and coherence of one axis in three panels."""
    frequency, n = response.frequency, POSE.index(name)
    is_seen = response.coherence[:, n] > response.significant_coherence
    line = {"color": chosen_hues().axes[name], "rasterized": len(frequency) > VECTOR_LINES}
    sizes, phases, coherences = panels
    draw_size(sizes, response, name, is_seen, line)
    sizes.set_title(style.component_label(name))
    inverse = "1/" if response.form.is_inverse else ""
    sizes.set_ylabel(f"{inverse}|H|, {response.form.unit_text(name, unit)}")
    draw_phase(phases, response, n, is_seen, line, bandwidth)
    draw_coherence(coherences, response, n, line)
    if bandwidth < frequency[-1]:
        sizes.axvline(bandwidth, color=chosen_hues().alarm, ls="--", lw=1.0)
    excited = frequency[response.is_excited]
    shown = max(frequency[0], 0.7 * excited.min()), min(frequency[-1], 1.3 * excited.max())
    for panel in panels:
        panel.set_xlim(*shown)
        shade(panel, frequency, ~response.is_excited)


def draw_size(
    panel: Axes, response: FrequencyResponse, name: str, is_seen: Booleans, line: dict[str, Any]
) -> None:
    """Draw both estimates with the random error, over the sensor's noise."""
    n, hues, form = POSE.index(name), chosen_hues(), response.form
    frequency, excited, scale = response.frequency, response.is_excited, response.form.factor(name)
    size, h2 = (scale * np.abs(each[:, n]) for each in (response.h1, response.h2))
    half = response.coverage_factor * response.random_error[:, n]
    floor = NOISE_95 ** (-1 if form.is_inverse else 1) * scale * response.noise_floor[:, n]
    smallest = np.median(floor[excited]), size[is_seen].min(initial=np.inf), np.median(size)
    ends = 0.2 * float(np.nanmin(smallest)), 2 * float(np.nanmax(size[excited]))
    panel.set(yscale="log", xscale="log")
    panel.fill_between(frequency, ends[form.is_inverse], floor, color=hues.grey, alpha=0.45, lw=0,
                       label=NOISE_LABEL if np.isfinite(floor).any() else None)  # fmt: skip
    panel.fill_between(frequency, size * np.maximum(1 - half, 1e-3), size * (1 + half),
                       alpha=0.25, lw=0, where=is_seen, label="random error of H1 (95 %)",
                       **line)  # fmt: skip
    panel.plot(frequency, keep(h2, is_seen), lw=0.5, label="H2", **line | {"color": hues.ink})
    panel.plot(frequency, size, lw=0.5, label="H1 where not significant",
               **line | {"color": hues.grey})  # fmt: skip
    panel.plot(frequency, keep(size, is_seen), label="H1", **line)
    if ends[1] > 0:  # an axis that is zero in all rows has no size to show
        panel.set_ylim(*ends)


def draw_phase(
    panel: Axes, response: FrequencyResponse, n: int, is_seen: Booleans, line: dict[str, Any],
    bandwidth: float,
) -> None:  # fmt: skip
    """Draw the phase, and that of the electronics' low pass."""
    frequency = response.frequency
    angle = np.degrees(np.angle(response.h1[:, n]))
    panel.plot(frequency, keep(angle, is_seen), ".", ms=1.2, **line)
    lag = np.degrees(np.angle(low_pass(frequency, bandwidth)))
    sign = -1 if response.form.is_inverse else 1
    panel.plot(frequency, sign * lag, "--", color=chosen_hues().alarm, lw=1.0,
               label=f"low pass of the electronics, {bandwidth:.4g} Hz")  # fmt: skip
    panel.set(ylim=(-200, 200), yticks=(-180, 0, 180), ylabel="phase, °")


def draw_coherence(panel: Axes, response: FrequencyResponse, n: int, line: dict[str, Any]) -> None:
    hues = chosen_hues()
    panel.plot(response.frequency, response.coherence[:, n], lw=0.7, **line)
    if response.multiple_coherence is not None:
        panel.plot(response.frequency, response.multiple_coherence[:, n], color=hues.ink, lw=0.5,
                   label="coherence with all inputs (multiple)")  # fmt: skip
    panel.axhline(response.significant_coherence, color=hues.grey, lw=0.8,
                  label="coherence by chance")  # fmt: skip
    panel.set(ylim=(0, 1.05), yticks=(0, 0.5), ylabel="coher.")


def keep(values: Floats, chosen: Booleans) -> Floats:
    """Return the chosen values, NaN elsewhere."""
    return np.where(chosen, values, np.nan)


def shade(panel: Axes, frequency: Floats, is_unexcited: Booleans) -> None:
    """Hatch the bands in which the input has hardly any power."""
    label = "hardly any input" if is_unexcited.any() else None
    panel.fill_between(
        frequency, 0, 1, where=is_unexcited, label=label, transform=panel.get_xaxis_transform(),
        facecolor="none", edgecolor=chosen_hues().rule, hatch="////", lw=0,
    )  # fmt: skip
