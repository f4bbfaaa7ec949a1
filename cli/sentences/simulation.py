"""The output of `facets simulate`: errors of a motion by axis, and the outcome of its samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facets import core, simulation
from facets.core.plain_numbers import count_text

from ..console import show_table

if TYPE_CHECKING:
    from facets.core.rigid_body import MeasuredObject
    from facets.simulation.run import AxisErrors, Segment


def print_segment(segment: Segment, body: MeasuredObject | None) -> None:
    """Print the errors of one motion by axis, of mirror and object, then the outcome of its
    samples."""
    print_errors(segment.name, simulation.run.axes(segment))
    if body is not None:
        print_errors(f"{segment.name}: the object", simulation.run.axes(segment, body))
    print(outcome(segment))


def print_errors(title: str, axes: list[AxisErrors]) -> None:
    headings = ("axis", "moved from", "to", "", "max error", "RMS error", "u (1 sigma)", "")
    rows = []
    for axis in axes:
        unit, factor, fine_unit, fine = core.units.unit_of(axis.name)
        moved = (f"{factor * axis.low:.4g}", f"{factor * axis.high:.4g}", unit)
        sizes = (axis.largest, axis.rms, axis.uncertainty)
        errors = [f"{fine * size:.3g}" if size == size else "-" for size in sizes]
        rows.append([axis.name, *(moved if axis.is_varied else ("", "", "")), *errors, fine_unit])
    show_table(title, headings, rows, left_columns=(0, 3, 7))


def outcome(segment: Segment) -> str:
    """Samples by status, detectors that read nothing, and the largest cross-axis error."""
    counts = ", ".join(
        f"{count:,} {label}" for label, count in simulation.run.statuses(segment).items()
    )
    text = f"  {count_text(len(segment.time), 'sample')}: {counts}"
    lost = {"the spot missed it": ~segment.reached, "it was saturated": segment.saturated}
    for why, which in lost.items():
        for letter, count in zip("ABC", which.sum(axis=0).tolist(), strict=True):
            if count:
                text += f"\n  {count_text(count, 'sample')} without PSD {letter}: {why}"
    still = [
        axis
        for axis in simulation.run.axes(segment)
        if not axis.is_varied and axis.largest == axis.largest
    ]
    for kind in (core.units.LENGTH, core.units.ANGLE):
        group = [axis for axis in still if core.units.unit_of(axis.name) == kind]
        if group and len(still) < 6:
            worst = max(group, key=lambda axis: axis.largest)
            error = f"{worst.largest * kind.fine_factor:.3g} {kind.fine_unit}"
            text += f"\n  largest cross-axis error: {error} in {worst.name}"
    return text
