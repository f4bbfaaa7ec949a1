"""What `facets response` prints: the frame of an estimate, and its peaks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from facets.core.names import POSE

from ..console import show_table

if TYPE_CHECKING:
    from facets.responses.findings import Peak
    from facets.responses.frequency_response import FrequencyResponse
    from facets.responses.signals import ResponseSignals


def show_estimate(
    estimate: FrequencyResponse,
    signals: ResponseSignals,
    peaks: list[Peak],
    unit: str,
    point: str,
) -> None:
    """Print the estimate's frame, and the peaks.

    estimate: in the form that is shown.  peaks: of the receptance.
    """
    lines = estimate.frequency[estimate.is_excited]
    typer.echo(
        f"{len(signals.stimulus)} rows at {estimate.rate:.6g} Hz: {estimate.segments} segments, "
        f"{estimate.averages:.3g} independent averages, a line every {estimate.resolution:.4g} Hz; "
        f"the input has power from {lines.min():.4g} to {lines.max():.4g} Hz"
    )
    typer.echo(f"{point}")
    form = estimate.form
    rows = []
    for peak in peaks:
        place = peak.line, POSE.index(peak.axis)
        error = estimate.coverage_factor * estimate.random_error[place]
        rows.append([
            f"{peak.frequency:.5g}", peak.axis,
            f"{form.factor(peak.axis) * abs(estimate.h1[place]):.4g}",
            form.unit_text(peak.axis, unit),
            f"{100 * error:.2g} %" if estimate.is_stationary else "unknown", f"{peak.width:.3g}",
            f"{estimate.coherence[place]:.4f}",
        ])  # fmt: skip
    if rows:
        headings = (
            "Hz",
            "axis",
            "1/|H1|" if form.is_inverse else "|H1|",
            "",
            "random (95 %)",
            "width, Hz",
            "coherence",
        )
        show_table("peaks, at lines of the estimate", headings, rows, left=(1, 3))
    else:
        typer.echo("No peak stands out of its surroundings by a factor of 3.")
