"""The page of a recording's noise: spectra, Allan deviations, and their components."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ...characterization.noise_model import fill
from ...characterization.rest import NOT_NOISE
from ...core.hues import DASHES, chosen_hues
from ...core.names import ANGLES, DETECTORS, POSE
from ...core.units import Floats, write_micro
from .. import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...characterization.noise_report import Channel, NoiseReport

CSS = """body{font:15px/1.5 system-ui,sans-serif;max-width:75rem;margin:2rem auto;padding:0 1rem;
background:var(--ground);color:var(--ink)}table{border-collapse:collapse;font-size:13px}
td,th{padding:.2rem .6rem;text-align:right;border-bottom:1px solid var(--rule)}
td:first-child,th:first-child{text-align:left}svg{max-width:100%;width:46rem;height:auto}
p{max-width:50rem}section{overflow-x:auto}"""


def page(report: NoiseReport, title: str, about: dict[str, str]) -> str:
    readings, poses = report.channels[:9], report.channels[9:]
    head = "".join(
        f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in about.items()
    )
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p>{report.samples} samples in {report.seconds:.4g} s at {report.rate:.6g} Hz, "
        f"{report.missing} missing. What the mirror did while it was recorded is part of all this: "
        "noise is what a mirror that stands still gives.</p>",
        faults(report.faults),
        f"<section><table>{table(report.channels)}</table></section>",
        "<p>Amplitudes with 95 % intervals. In the spectra a band reaches from the least to the "
        "largest of neighbouring frequencies, the line is the fitted white and flicker noise, and "
        "dotted is the configured noise as white: one standard deviation squared over half the "
        "rate. Thin upright lines are found lines. Bands of the Allan deviations are 95 % "
        "intervals.</p>",
        spectra("Spectra of the readings", group_channels(readings)),
        spectra("Spectra of the poses", group_channels(poses)),
        deviations(group_channels(report.channels)),
        "<h2>Correlation of the readings&#39; fast noise</h2>",
        f"<table>{correlations(report)}</table>",
        f"<p>The three powers have {1e6 * report.common:.3g} ppm in common (the laser)."
        f"{'' if report.faults else configuration_text(report)}</p>",
        f"<h2>How this was made</h2><table>{head}</table>",
    ]  # fmt: skip
    body = "\n".join(parts)
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(title)}</title>"
        f"<style>{chosen_hues().css}{CSS}</style>\n{body}\n</html>\n"
    )


def faults(sentences: list[str]) -> str:
    """List the findings that contradict a mirror at rest."""
    if not sentences:
        return ""
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<p><strong>{NOT_NOISE.capitalize()}:</strong></p><ul>{items}</ul>"


def configuration_text(report: NoiseReport) -> str:
    return (
        f" For the configuration: position_um {1e3 * report.position:.4g} at {report.at_power:g} "
        f"mW, power_uw {1e3 * report.power:.4g}."
    )


def table(channels: list[Channel]) -> str:
    words = ("channel", "white /&radic;Hz", "flicker at 1 Hz /&radic;Hz", "drift /s", "1 sigma",
             "configured", "ratio", "lines", "spikes")  # fmt: skip
    rows = ["<tr>" + "".join(f"<th>{word}</th>" for word in words) + "</tr>"]
    for channel in channels:
        model = channel.model
        lines = "; ".join(
            f"{line.name}: {line.amplitude.value:.3g} at {line.frequency:.2f} Hz"
            if line.name != "unknown"
            else f"{line.amplitude.value:.3g} at {line.frequency:.2f} Hz"
            for line in model.lines
        )
        cells = (
            f"{channel.name} ({write_micro(channel.unit)})", amplitude(model.white),
            amplitude(model.flicker),
            f"{model.drift.value:.2g} &plusmn; {1.96 * model.drift.sigma:.1g}",
            f"{model.standard_deviation:.3g}", f"{channel.configured:.3g}",
            f"{model.standard_deviation / channel.configured:.2f}", lines or "none",
            str(model.spikes),
        )  # fmt: skip
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return "".join(rows)


def amplitude(density: Any) -> str:
    low, high = np.sqrt(np.maximum(0.0, density.interval))
    return f"{np.sqrt(max(density.value, 0.0)):.3g} ({low:.3g} to {high:.3g})"


def correlations(report: NoiseReport) -> str:
    names = [channel.name.rpartition("_")[0] for channel in report.channels[:9]]
    rows = ["<tr><th></th>" + "".join(f"<th>{name}</th>" for name in names) + "</tr>"]
    for name, values in zip(names, report.correlation, strict=True):
        cells = "".join(f"<td>{value:+.2f}</td>" for value in values)
        rows.append(f"<tr><td>{name}</td>{cells}</tr>")
    return "".join(rows)


def spectra(title: str, groups: dict[str, list[Channel]]) -> str:
    """Draw Welch's spectra, a panel for each group of channels that share a unit."""
    with style.style_context():
        picture, panels = page_of(len(groups))
        for panel, (name, channels) in zip(panels, groups.items(), strict=False):
            for channel in channels:
                spectrum(panel, channel)
            for line in {
                round(x.frequency, 2) for channel in channels for x in channel.model.lines[:5]
            }:
                panel.axvline(line, color=chosen_hues().rule, lw=1.0, zorder=0)
            unit = write_micro(channels[0].unit)
            panel.set(xscale="log", yscale="log", xlabel="frequency, Hz", title=name)
            panel.set_ylabel(f"amplitude density, {unit}/√Hz")
        legend(picture, panels, groups)
    return f"<h2>{title}</h2>{style.svg_text(picture)}"


def spectrum(panel: Axes, channel: Channel) -> None:
    """Draw the measured spectrum as a band, the fitted noise, and the configured noise dashed."""
    from scipy.signal import welch

    rate, hue = channel.model.rate, hue_of(channel.name)
    signal = fill(channel.signal) - channel.model.mean
    piece = 1 << max(6, int(np.log2(len(signal) / 8)))
    frequency, power = welch(signal, rate, nperseg=min(piece, len(signal)))
    band = columns(frequency[1:], np.sqrt(power[1:]))
    panel.fill_between(band.time, band.low, band.high, color=hue, alpha=0.35, lw=0)
    panel.plot(band.time, band.middle, color=hue, lw=0.5, alpha=0.7)
    fitted = np.sqrt(channel.model.density(band.time))
    panel.plot(band.time, fitted, color=hue, lw=1.6, ls=dash_of(channel.name))
    level = channel.configured * np.sqrt(2 / rate)
    panel.plot(band.time[[0, -1]], [level, level], color=hue, ls=(0, (1, 1.5)), lw=1.4)


def columns(frequency: Floats, density: Floats, count: int = 140) -> style.Band:
    """Return least, largest and median in columns that are equally wide on a logarithmic axis."""
    edges = np.geomspace(frequency[0], frequency[-1] * (1 + 1e-9), count + 1)
    which = np.digitize(frequency, edges)
    rows = [(np.sqrt(edges[n - 1] * edges[n]), *style.ends(density[which == n]))
            for n in np.unique(which)]  # fmt: skip
    return style.Band(*np.array(rows).T)


def deviations(groups: dict[str, list[Channel]]) -> str:
    """Draw Allan deviations of readings and poses, with their 95 % intervals."""
    with style.style_context():
        picture, panels = page_of(len(groups))
        for panel, (name, channels) in zip(panels, groups.items(), strict=False):
            for channel in channels:
                hue, allan = hue_of(channel.name), channel.allan
                panel.fill_between(allan.tau, allan.low, allan.high, color=hue, alpha=0.2, lw=0)
                panel.plot(allan.tau, allan.deviation, color=hue, ls=dash_of(channel.name))
            unit = write_micro(channels[0].unit)
            panel.set(xscale="log", yscale="log", xlabel="averaging time, s", title=name)
            panel.set_ylabel(f"Allan deviation, {unit}")
        legend(picture, panels, groups)
    return f"<h2>Allan deviations</h2>{style.svg_text(picture)}"


def page_of(count: int) -> tuple[Figure, Any]:
    """Make a picture of panels in two columns."""
    rows = -(-count // 2)
    picture = style.figure(style.FULL, 2.6 * rows + 0.4)
    panels = picture.subplots(rows, 2, squeeze=False).ravel()
    for panel in panels[count:]:
        panel.set_axis_off()
    return picture, panels


def legend(picture: Figure, panels: Any, groups: dict[str, list[Channel]]) -> None:
    """Explain hues and dashes: detectors by letter, axes by name."""
    from matplotlib.lines import Line2D

    names = list(
        dict.fromkeys(channel.name.rpartition("_")[0] for g in groups.values() for channel in g)
    )
    axes = [name for name in names if name in POSE]
    letters = [letter for letter in DETECTORS if any(name.endswith(f"_{letter}") for name in names)]
    hues = chosen_hues()
    handles = [Line2D([], [], color=hues.detectors[letter]) for letter in letters]
    handles += [Line2D([], [], color=hues.axes[name], ls=DASHES[name]) for name in axes]
    texts = [f"detector {letter.upper()}" for letter in letters]
    texts += [style.component_label(name) for name in axes]
    style.legend_below(picture, handles, texts, min(len(texts), 5))


def hue_of(column: str) -> str:
    """Return the hue of a column's detector or axis: "psi_a_mm", "roll_mrad"."""
    name = column.rpartition("_")[0]
    hues = chosen_hues()
    return hues.axes[name] if name in hues.axes else hues.detectors[name[-1]]


def dash_of(column: str) -> str:
    return DASHES.get(column.rpartition("_")[0], "-")


def group_channels(channels: list[Channel]) -> dict[str, list[Channel]]:
    """Group channels by panel: psi, zeta and power of readings, shifts and angles of poses."""
    words = {"psi": "place psi", "zeta": "place zeta", "power": "power"}
    groups: dict[str, list[Channel]] = {}
    for channel in channels:
        name = channel.name.rpartition("_")[0]
        kind = "angles" if name in ANGLES else "shifts" if name in POSE else words[name[:-2]]
        groups.setdefault(kind, []).append(channel)
    return groups
