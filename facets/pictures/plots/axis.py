"""The picture and the page of a test of an axis.

The picture has the runs in both directions with their means and the band, and the other five error
motions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...axis_tests.positioning import standard_deviations_of_runs, unidirectional_means
from ...core.hues import chosen_hues
from ...core.units import round_to, write_micro
from .. import style
from ..reports import report_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...axis_tests.report import AxisReport

#: Marks and names of the two directions of approach.
DIRECTIONS = (("^", "positive direction"), ("v", "negative direction"))
#: Dashes of the error motions in one panel.
DASHES = ("-", "--", ":")


def axis_picture(report: AxisReport) -> Figure:
    """Draw the positioning deviations of all runs, and the other shifts and angles below."""
    main = report.motions.main
    with style.style_context():
        picture = style.figure(style.FULL, 8.2)
        upper, *lower = picture.subplots(3, 1, sharex=True, height_ratios=(1.6, 1, 1))
        draw_positioning(upper, report)
        for panel, kind in zip(lower, (range(3), range(3, 6)), strict=True):
            draw_means(panel, report, [n for n in kind if n != main])
        unit, _ = report.position_unit
        lower[-1].set_xlabel(f"commanded position, {unit}")
    return picture


def draw_positioning(panel: Axes, report: AxisReport) -> None:
    """Draw runs as thin lines, means as marks, and the band of two standard deviations."""
    main, hues = report.motions.main, chosen_hues()
    fine, scale = report.units(main)
    place = report.position_unit[1] * report.motions.targets
    x = scale * report.motions.values[main]
    means, spread = unidirectional_means(x), standard_deviations_of_runs(x)
    for n, (mark, words) in enumerate(DIRECTIONS):
        hue = hues.series[n]
        panel.plot(place, x[:, n], color=hue, lw=0.5, alpha=0.55)
        panel.plot(place, means[:, n], color=hue, marker=mark, ms=4, lw=1.4, label=words)
        band = np.nan_to_num(2 * spread[:, n])
        panel.fill_between(place, means[:, n] - band, means[:, n] + band, color=hue, alpha=0.14,
                           lw=0)  # fmt: skip
    panel.plot(place, scale * report.means[main], color=hues.ink, lw=1.2, ls="--", label="mean")
    panel.set_title(f"positioning, {report.motions.names[main]}: runs, means and ±2 s")
    panel.set_ylabel(f"deviation, {write_micro(fine)}")
    panel.legend(loc="best", ncols=3)


def draw_means(panel: Axes, report: AxisReport, components: list[int]) -> None:
    """Draw mean error motions with the band of their expanded uncertainties."""
    fine, scale = report.units(components[0])
    place = report.position_unit[1] * report.motions.targets
    for n, dash in zip(components, DASHES, strict=False):
        hue = chosen_hues().series[2:][components.index(n)]
        mean, wide = scale * report.means[n], 2 * scale * report.uncertainties[n]
        panel.fill_between(place, mean - wide, mean + wide, color=hue, alpha=0.2, lw=0)
        panel.plot(place, mean, color=hue, ls=dash, marker="o", ms=2.5,
                   label=report.motions.names[n])  # fmt: skip
    names = ", ".join(report.motions.names[n] for n in components)
    panel.set_title(f"{names}: means and expanded uncertainty (k = 2)")
    panel.set_ylabel(f"error, {write_micro(fine)}")
    panel.legend(loc="best", ncols=3)


def axis_page(report: AxisReport, title: str, about: dict[str, str]) -> str:
    """Write the page of a test: picture, quantities, error motions by position, and notes."""
    section, motions = report_page.ReportSection, report.motions
    notes = report.notes() or ["No dwell was excluded, and no drift was found."]
    fine, scale = report.units(motions.main)
    rows = [
        (q.name, q.symbol, *value_cells(scale * q.value, scale * q.expanded))
        for q in report.quantities[motions.main]
    ]
    sections = [
        section("What needs attention", notes, wide=True),
        section(
            f"Positioning of the axis {motions.axis}, {write_micro(fine)}",
            [
                "Quantities of ISO 230-2, clause 3, with the expanded uncertainty U by the "
                "sensor (k = 2). U does not include the set-up or the environment."
            ],
            ("quantity", "symbol", "value", "U"),
            rows,
        ),
        section(
            "Other error motions",
            [
                "Names of ISO 230-1. Range: from the smallest to the largest mean of both "
                f"directions; straightness and tilt relative to the line: {report.line}."
            ],
            ("error", "unit", "range", "U", "reversal", "U"),
            other_rows(report),
        ),
        section("Runs", drawing=report_page.inline(axis_picture(report), title), wide=True),
        position_section(report),
        section("How this was made", text="\n".join(f"{k}: {v}" for k, v in about.items()),
                wide=True),
    ]  # fmt: skip
    words = (
        f"{len(report.visits.target)} dwells at {len(motions.targets)} positions; at each at least "
        f"{report.runs[0]} runs in the positive direction and {report.runs[1]} in the negative "
        f"one. {report.alignment()}"
    )
    return report_page.report(title, words, sections, about["command"])


def other_rows(report: AxisReport) -> list[tuple[str, ...]]:
    """Return the ranges and reversals of all error motions except positioning."""
    rows: list[tuple[str, ...]] = []
    for n, name in enumerate(report.motions.names):
        if n == report.motions.main:
            continue
        unit, scale = report.units(n)
        quantities = {q.symbol: q for q in report.quantities[n]}
        has_both = np.isfinite(quantities["M"].value)
        extent = quantities["M"] if has_both else quantities["E_up" if report.runs[0] else "E_down"]
        cells = [
            value_cells(scale * q.value, scale * q.expanded) for q in (extent, quantities["B"])
        ]
        rows.append((name, write_micro(unit), *cells[0], *cells[1]))
    return rows


def position_section(report: AxisReport) -> Any:
    """Make the section of the error motions by position."""
    unit, factor = report.position_unit
    units = [report.units(n) for n in range(6)]
    heads = [
        f"{name}, {write_micro(fine)}"
        for name, (fine, _) in zip(report.motions.names, units, strict=True)
    ]
    rows = [
        [
            f"{factor * target:.6g}",
            *(
                " ± ".join(
                    value_cells(scale * report.means[n, m], 2 * scale * report.uncertainties[n, m])
                )
                for n, (_, scale) in enumerate(units)
            ),
        ]
        for m, target in enumerate(report.motions.targets)
    ]
    words = ["Errors, actual less commanded, with expanded uncertainties. Corrections have the "
             "opposite sign."]  # fmt: skip
    return report_page.ReportSection(
        "Error motions by position", words, (f"position, {unit}", *heads), rows, wide=True
    )


def value_cells(value: float, expanded: float) -> tuple[str, str]:
    """Format a value and its uncertainty, which has two digits and the value's decimals."""
    if not np.isfinite(value):
        return "-", "-"
    if not expanded > 0:
        return f"{value:.4g}", "-" if np.isnan(expanded) else "0"
    return round_to(value, expanded), round_to(expanded, expanded)
