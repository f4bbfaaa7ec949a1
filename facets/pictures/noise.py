"""The page of a recording's noise: spectra, Allan deviations, and what they are made of."""

from __future__ import annotations

from html import escape
from io import StringIO
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ..characterization.noise_report import Channel, NoiseReport

STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:75rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse;font-size:13px}td,th{padding:.2rem .6rem;text-align:right;
border-bottom:1px solid #ddd}td:first-child,th:first-child{text-align:left}svg{max-width:100%;
height:auto}p{max-width:50rem}"""
COLOURS = ("#0b5fa5", "#c4501b", "#2d7d46")


def page(report: NoiseReport, title: str, about: dict[str, str]) -> str:
    """One page of HTML with everything in it."""
    readings, poses = report.channels[:9], report.channels[9:]
    head = "".join(
        f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in about.items()
    )
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p>{report.samples} samples in {report.seconds:.4g} s at {report.rate:.6g} Hz, "
        f"{report.missing} missing. What the mirror did while it was recorded is part of all this: "
        "noise is what a mirror that stands still gives.</p>",
        f"<table>{table(report.channels)}</table>",
        "<p>Amplitudes with 95 % intervals. Dashed in the spectra: the configured noise as white, "
        "one standard deviation squared over half the rate. Bands of the Allan deviations are 95 % "
        "intervals.</p>",
        spectra("Readings", readings), spectra("Poses", poses), deviations(report.channels),
        "<h2>Correlation of the readings&#39; fast noise</h2>",
        f"<table>{correlations(report)}</table>",
        f"<p>The three powers have {1e6 * report.common:.3g} ppm in common (the laser). For the "
        f"configuration: position_um {1e3 * report.position:.4g} at {report.at_power:g} mW, "
        f"power_uw {1e3 * report.power:.4g}.</p>",
        f"<h2>How this was made</h2><table>{head}</table>",
    ]  # fmt: skip
    body = "\n".join(parts)
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(title)}</title>"
        f"<style>{STYLE}</style>\n{body}\n</html>\n"
    )


def table(channels: list[Channel]) -> str:
    words = ("channel", "white /&radic;Hz", "flicker at 1 Hz /&radic;Hz", "drift /s", "1 sigma",
             "configured", "ratio", "lines", "spikes")  # fmt: skip
    rows = ["<tr>" + "".join(f"<th>{word}</th>" for word in words) + "</tr>"]
    for one in channels:
        model = one.model
        lines = "; ".join(
            f"{line.name}: {line.amplitude.value:.3g} at {line.frequency:.2f} Hz"
            if line.name != "unknown"
            else f"{line.amplitude.value:.3g} at {line.frequency:.2f} Hz"
            for line in model.lines
        )
        cells = (
            f"{one.name} ({one.unit})", amplitude(model.white), amplitude(model.flicker),
            f"{model.drift.value:.2g} &plusmn; {1.96 * model.drift.sigma:.1g}",
            f"{model.standard_deviation:.3g}", f"{one.configured:.3g}",
            f"{model.standard_deviation / one.configured:.2f}", lines or "none", str(model.spikes),
        )  # fmt: skip
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return "".join(rows)


def amplitude(density: Any) -> str:
    low, high = np.sqrt(np.maximum(0.0, density.interval))
    return f"{np.sqrt(max(density.value, 0.0)):.3g} ({low:.3g} to {high:.3g})"


def correlations(report: NoiseReport) -> str:
    names = [one.name.rpartition("_")[0] for one in report.channels[:9]]
    rows = ["<tr><th></th>" + "".join(f"<th>{name}</th>" for name in names) + "</tr>"]
    for name, values in zip(names, report.correlation, strict=True):
        cells = "".join(f"<td>{value:+.2f}</td>" for value in values)
        rows.append(f"<tr><td>{name}</td>{cells}</tr>")
    return "".join(rows)


def spectra(title: str, channels: list[Channel]) -> str:
    """Welch's spectra of some channels, three in a picture."""
    from matplotlib.figure import Figure
    from scipy.signal import welch

    from ..characterization.noise_model import fill

    figure = Figure(figsize=(13, 4.2), layout="constrained")
    count = len(channels) // 3
    for panel in range(3):
        axes = figure.add_subplot(1, 3, panel + 1)
        mine = channels[panel::3] if title == "Readings" else channels[panel * count :][:count]
        for one, colour in zip(mine, COLOURS, strict=False):
            rate = one.model.rate
            signal = fill(one.signal) - one.model.mean
            piece = 1 << max(6, int(np.log2(len(signal) / 8)))
            frequency, power = welch(signal, rate, nperseg=min(piece, len(signal)))
            axes.loglog(frequency[1:], np.sqrt(power[1:]), colour, lw=0.8, label=one.name)
            axes.loglog(frequency[1:], np.sqrt(one.model.density(frequency[1:])), colour, lw=1.8)
            level = one.configured * np.sqrt(2 / rate)
            axes.axhline(level, color=colour, ls="--", lw=1)
            for line in one.model.lines[:5]:
                axes.axvline(line.frequency, color="0.7", lw=0.6, zorder=0)
        axes.set_xlabel("frequency, Hz")
        units = sorted({one.unit for one in mine})
        axes.set_ylabel(f"{' or '.join(units)} per root Hz")
        axes.legend(fontsize=8)
    figure.suptitle(
        f"{title}: amplitude spectral densities, and the fitted white and flicker noise"
    )
    return svg(figure)


def deviations(channels: list[Channel]) -> str:
    """Allan deviations of readings and poses."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 4.2), layout="constrained")
    groups = ("um", "uW", "urad")
    for panel, unit in enumerate(groups):
        axes = figure.add_subplot(1, 3, panel + 1)
        for one in channels:
            if one.unit == unit:
                (drawn,) = axes.loglog(one.allan.tau, one.allan.deviation, lw=1, label=one.name)
                axes.fill_between(
                    one.allan.tau,
                    one.allan.low,
                    one.allan.high,
                    color=drawn.get_color(),
                    alpha=0.15,
                )
        axes.set_xlabel("averaging time, s")
        axes.set_ylabel(f"Allan deviation, {unit}")
        axes.legend(fontsize=7)
    return svg(figure)


def svg(figure: Any) -> str:
    stream = StringIO()
    figure.savefig(stream, format="svg")
    text = stream.getvalue()
    return text[text.index("<svg") :]
