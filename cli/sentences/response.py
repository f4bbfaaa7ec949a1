"""The output of `facets response`: an estimate, its peaks and its limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facets import responses
from facets.core.names import POSE
from facets.core.plain_numbers import count_text

from ..console import show_table

if TYPE_CHECKING:
    from facets.responses.forms import ResponseForm
    from facets.responses.frequency_response import FrequencyResponse
    from facets.responses.signals import ResponseSignals


def show_response(
    signals: ResponseSignals,
    receptance: FrequencyResponse,
    form: ResponseForm,
    unit: str,
    point: str,
    bandwidth: float,
) -> None:
    """Print the frame of an estimate, its peaks in a form, and what limits it."""
    estimate, findings = receptance.convert(form), responses.findings
    peaks = findings.find_peaks(receptance)
    lines = estimate.frequency[estimate.is_excited]
    print(
        f"{count_text(len(signals.stimulus), 'row')} at {estimate.rate:.6g} Hz: "
        f"{count_text(estimate.segments, 'segment')}, "
        f"{estimate.averages:.3g} independent averages, a line every {estimate.resolution:.4g} Hz; "
        f"the input has power from {lines.min():.4g} to {lines.max():.4g} Hz"
    )
    print(f"{point}")
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
        show_table("peaks, at lines of the estimate", headings, rows, left_columns=(1, 3))
    else:
        print("No peak stands out of its surroundings by a factor of 3.")
    limits = findings.find_limits(receptance, signals, peaks, bandwidth)
    print("\n".join(f"  {text}" for text in limits))
