"""The page of a recording's noise: spectra, Allan deviations, and their components."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.hues import DASHES, chosen_hues
from ...core.names import ANGLES, POSE
from ...core.units import write_micro
from ...noise_analysis.noise_model import fill
from ...noise_analysis.rest import NOT_NOISE
from .. import style
from ..reports import report_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...noise_analysis.noise_report import Channel, NoiseReport

#: Number of columns of a spectrum's band, equally wide on the logarithmic axis.
COLUMNS = 140
#: Labels of both axes, and the picture in words.
SPECTRA = ("frequency, Hz", "amplitude density, {}/√Hz", "spectra of the noise")
DEVIATIONS = ("averaging time, s", "Allan deviation, {}", "Allan deviations")


def page(report: NoiseReport, title: str, about: dict[str, str]) -> str:
    """Write the page of a recording's noise: channels, spectra, Allan deviations, correlations."""
    section, readings, poses = report_page.ReportSection, report.channels[:9], report.channels[9:]
    words = (
        f"{report.samples} samples in {report.seconds:.4g} s at {report.rate:.6g} Hz, "
        f"{report.missing} missing. Motion of the mirror during the recording is part of these "
        "numbers: they are noise if the mirror was at rest."
    )
    common = f"The three powers have {1e6 * report.common:.3g} ppm in common (the laser)."
    if not report.faults:
        common += (
            f" For the configuration: position_um {1e3 * report.position:.4g} at "
            f"{report.at_power:g} mW, power_uw {1e3 * report.power:.4g}."
        )
    names = [channel.name.rpartition("_")[0] for channel in readings]
    sections = [
        section(
            "Channels",
            [
                "Amplitudes have 95 % intervals. In the spectra, bands reach from the minimum to "
                "the maximum of neighbouring frequencies, lines are the fitted white and flicker "
                "noise, dotted lines the configured noise as white noise (its variance over half "
                "the rate), and thin vertical lines the detected spectral lines. Bands of the "
                "Allan deviations are 95 % intervals."
            ],
            ("channel", "white /√Hz", "flicker at 1 Hz /√Hz", "drift /s", "1 sigma", "configured",
             "ratio", "lines", "spikes"),
            [channel_cells(channel) for channel in report.channels],
            wide=True,
        ),
        section("Spectra of the readings", drawing=draw_groups(readings, draw_spectrum, *SPECTRA)),
        section("Spectra of the poses", drawing=draw_groups(poses, draw_spectrum, *SPECTRA)),
        section("Allan deviations",
                drawing=draw_groups(report.channels, draw_deviation, *DEVIATIONS), wide=True),
        section(
            "Correlation of the readings' fast noise",
            [common],
            ("", *names),
            [
                (name, *(f"{value:+.2f}" for value in values))
                for name, values in zip(names, report.correlation, strict=True)
            ],
            wide=True,
        ),
        section("How this was made", text="\n".join(f"{k}: {v}" for k, v in about.items()),
                wide=True),
    ]  # fmt: skip
    warning = f"{NOT_NOISE.capitalize()}: {' '.join(report.faults)}" if report.faults else ""
    return report_page.report(title, words, sections, about["command"], warning)


def channel_cells(channel: Channel) -> tuple[str, ...]:
    """Return the cells of a channel's row in the table."""
    model = channel.model
    lines = "; ".join(
        f"{line.name + ': ' if line.name != 'unknown' else ''}{line.amplitude.value:.3g} at "
        f"{line.frequency:.2f} Hz"
        for line in model.lines
    )
    return (
        f"{channel.name} ({write_micro(channel.unit)})", amplitude(model.white),
        amplitude(model.flicker), f"{model.drift.value:.2g} ± {1.96 * model.drift.sigma:.1g}",
        f"{model.standard_deviation:.3g}", f"{channel.configured:.3g}",
        f"{model.standard_deviation / channel.configured:.2f}", lines or "none", str(model.spikes),
    )  # fmt: skip


def amplitude(density: Any) -> str:
    low, high = np.sqrt(np.maximum(0.0, density.interval))
    return f"{np.sqrt(max(density.value, 0.0)):.3g} ({low:.3g} to {high:.3g})"


def draw_groups(
    channels: list[Channel], draw: Callable[[Axes, Channel], None], across: str, up: str, words: str
) -> str:  # fmt: skip
    """Draw channels on logarithmic scales, one panel for each group, as an SVG element.

    across, up: labels of the axes, the second one with {} for the unit.
    """
    groups = group_channels(channels)
    rows = -(-len(groups) // 2)
    with style.style_context():
        picture = style.figure(style.FULL, 2.6 * rows + 0.4)
        panels = picture.subplots(rows, 2, squeeze=False).ravel()
        for panel in panels[len(groups) :]:
            panel.set_axis_off()
        for panel, (name, group) in zip(panels, groups.items(), strict=False):
            panel.set(xscale="log", yscale="log", xlabel=across, title=name)
            panel.set_ylabel(up.format(write_micro(group[0].unit)))
            for channel in group:
                draw(panel, channel)
                panel.plot([], [], label=words_of(channel.name), **line_of(channel.name))
        style.panels_legend(picture, panels, min(len(groups) + 2, 5))
    return report_page.inline(picture, words)


def draw_spectrum(panel: Axes, channel: Channel) -> None:
    """Draw a channel's spectrum as a band, its fitted and configured noise, and its lines."""
    from scipy.signal import welch

    rate, line = channel.model.rate, line_of(channel.name)
    hue = line["color"]
    signal = fill(channel.signal) - channel.model.mean
    piece = 1 << max(6, int(np.log2(len(signal) / 8)))
    frequency, power = welch(signal, rate, nperseg=min(piece, len(signal)))
    frequency, density = frequency[1:], np.sqrt(power[1:])
    edges = np.geomspace(frequency[0], frequency[-1], COLUMNS + 1)[1:-1]
    band = style.band(frequency, density, np.unique(np.searchsorted(frequency, edges)))
    panel.fill_between(band.time, band.low, band.high, color=hue, alpha=0.35, lw=0)
    panel.plot(band.time, band.middle, color=hue, lw=0.5, alpha=0.7)
    panel.plot(band.time, np.sqrt(channel.model.density(band.time)), lw=1.6, **line)
    level = channel.configured * np.sqrt(2 / rate)
    panel.plot(band.time[[0, -1]], [level, level], color=hue, ls=(0, (1, 1.5)), lw=1.4)
    for peak in channel.model.lines[:5]:
        panel.axvline(peak.frequency, color=chosen_hues().rule, lw=1.0, zorder=0)


def draw_deviation(panel: Axes, channel: Channel) -> None:
    """Draw the Allan deviation with its 95 % interval."""
    allan, line = channel.allan, line_of(channel.name)
    panel.fill_between(allan.tau, allan.low, allan.high, color=line["color"], alpha=0.2, lw=0)
    panel.plot(allan.tau, allan.deviation, **line)


def line_of(column: str) -> dict[str, Any]:
    """Return hue and dash of a column's detector or axis: "psi_a_mm", "roll_mrad"."""
    name = column.rpartition("_")[0]
    hues = chosen_hues()
    hue = hues.axes[name] if name in hues.axes else hues.detectors[name[-1]]
    return {"color": hue, "ls": DASHES.get(name, "-")}


def words_of(column: str) -> str:
    """Return the axis or the detector of a column in words."""
    name = column.rpartition("_")[0]
    return style.component_label(name) if name in POSE else f"detector {name[-1].upper()}"


def group_channels(channels: list[Channel]) -> dict[str, list[Channel]]:
    """Group channels by panel: psi, zeta and power of readings, shifts and angles of poses."""
    words = {"psi": "place psi", "zeta": "place zeta", "power": "power"}
    groups: dict[str, list[Channel]] = {}
    for channel in channels:
        name = channel.name.rpartition("_")[0]
        kind = "angles" if name in ANGLES else "shifts" if name in POSE else words[name[:-2]]
        groups.setdefault(kind, []).append(channel)
    return groups
