"""The calibration certificate that `facets calibrate --report` writes: one page."""

from __future__ import annotations

import platform
from hashlib import sha256
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...calibration import uncertainty as budgets
from ...calibration.table import parameter_table
from ...core.names import POSE
from ...core.units import MICRO, round_to, unit_of, write_micro
from ...core.version import __version__
from ...estimation.uncertainty import coverage_factor
from ...files.provenance import origin_line, provenance_header
from ...files.whole import write_text
from .report_page import ReportSection, report

if TYPE_CHECKING:
    from pathlib import Path

    from ...calibration.uncertainty import Budget
    from ...calibration.verdict import Verdict
    from ...config import Config
    from ...core.calibrate import Statement
    from ...core.sensor import Sensor
    from ...core.units import Floats

NOT_STATED = "not stated"
ENTRIES = {
    "number": "certificate number",
    "customer": "customer",
    "laboratory": "calibrated by (laboratory)",
    "operator": "responsible person",
    "date": "date of the measurement",
    "place": "place of the measurement",
    "sensor": "calibrated sensor",
    "serial": "its serial number",
    "reference": "reference instrument",
    "traceability": "traceability of the reference",
}
CONDITIONS = {
    "temperature": ("temperature", "°C"),
    "humidity": ("relative humidity", "%"),
    "pressure": ("air pressure", "hPa"),
}
#: Maximum number of correlated pairs of parameters on the page, and the minimum coefficient.
MOST_PAIRS, LEAST_CORRELATION = 20, 0.5
STATES = (
    "This page states the parameters that facets fitted to the data named below, with their "
    "expanded uncertainties and correlations, the uncertainty that they cause in poses, and what "
    "the software's checks of these data found. The results belong to this one sensor, in the "
    "state and under the conditions of the measurement."
)
DOES_NOT_STATE = (
    "This page is no certificate of an accredited laboratory, and the software has examined "
    "neither the reference instrument nor the laboratory. Entries on sensor, reference, "
    "traceability and conditions, and the reference's uncertainty, were copied from the "
    "configuration unchecked. The page does not state that the results hold outside the ranges "
    "listed under Validity, at other temperatures, at a later time, or after a part was moved or "
    "exchanged. It does not state conformity with a specification. It has nothing to do with the "
    "certificates of unique readings that --certify writes."
)


class ReportFiles(NamedTuple):
    """Files of a certificate.  page: its own.  sources, results: files that the calibration read
    and wrote, whose checksums the page states."""

    page: Path
    sources: list[Path]
    results: list[Path]


def write_report(
    settings: Config, calibrated: Config, verdict: Verdict, drawing: str, files: ReportFiles
) -> None:
    """Write the calibration certificate; a calibration that failed its checks has a warning.

    settings: the configuration before the calibration.  calibrated: the written configuration.
    drawing: SVG of the residuals.
    """
    statement = settings.calibrate.statement
    subject = statement.sensor or settings.name
    summary, warning = "The checks of this calibration found no reason to reject it.", ""
    title = f"Calibration certificate of {subject}"
    if not verdict.is_trusted:
        title = f"Calibration of {subject}: not valid"
        summary = "Written for inspection only, because --accept-misfit was given."
        warning = (
            "NOT VALID. The checks of this calibration failed: do not use these results. Reasons: "
            + " ".join(finding.words for finding in verdict.findings if finding.bad)
        )
    sheet = " · ".join(filter(None, ("Calibration", statement.number, settings.name)))
    if warning:
        sheet += " · NOT VALID"
    text = report(
        title, summary, sections(settings, calibrated, verdict, drawing, files),
        origin_line(settings), warning, sheet,
    )  # fmt: skip
    write_text(files.page, text)


def sections(
    settings: Config, calibrated: Config, verdict: Verdict, drawing: str, files: ReportFiles
) -> list[ReportSection]:
    assert verdict.fit is not None
    assert verdict.search is not None
    requests = settings.calibrate
    statement = requests.statement
    budget = budgets.calibration_budget(
        verdict.search.sensor, verdict.fitted, verdict.fit, calibrated.sensor, requests.outliers
    )
    states = budgets.fitted_states(verdict.fitted, verdict.fit)
    covariances = budgets.pose_covariances(
        calibrated.sensor, budget, np.vstack([np.zeros(8), states]),
        calibrated.solve.knowledge(calibrated.sensor),
    )  # fmt: skip
    parts = {source: np.diagonal(part, axis1=1, axis2=2) for source, part in covariances.items()}
    findings = [
        ("not passed: " if finding.bad else "") + finding.words for finding in verdict.findings
    ]
    entries = [[words, getattr(statement, name) or NOT_STATED] for name, words in ENTRIES.items()]
    return [
        ReportSection("Sensor and reference (entered by the user)", rows=entries, wide=True),
        ReportSection("What this page states, and what it does not", (STATES, DOES_NOT_STATE),
                      wide=True),
        ReportSection("Conditions", rows=condition_rows(statement, verdict)),
        ReportSection("Reference's standard uncertainty", ("Entered by the user.",),
                ("axis", "u"), reference_rows(requests.reference)),
        parameter_section(verdict, budget, calibrated.sensor),
        pose_section(budget, parts),
        ReportSection("Uncertainty budget of a pose",
                ("Fraction of each source in the variance that the calibration causes, at rest, %. "
                 "The noise of later readings is additional (facets resolution).",),
                ("source", *POSE), budget_rows(parts), wide=True),
        ReportSection("Check on samples that were not fitted",
                ("Errors of solved poses against the reference: robust estimate, stated standard "
                 "uncertainty, and fraction within 95 % intervals.",),
                ("axis", "error", "stated", "unit", "held, %"), error_rows(verdict.errors)),
        ReportSection("Residuals",
                ("Over each detector's face, and along the pose and the rows; noise shows no "
                 "pattern.",),
                drawing=drawing, wide=True),
        ReportSection("Correlations of poses",
                ("Coefficients of the errors that the calibration causes, at rest.",), ("", *POSE),
                pose_correlations(covariances)),
        correlation_section(calibrated),
        ReportSection("Validity", ("The sensor was calibrated within these ranges.",),
                ("quantity", "from", "to", "unit"),
                range_rows(verdict, states, statement.temperature)),
        ReportSection("Findings of the checks", findings or ["None."], wide=True),
        ReportSection("Method, software and files", wide=True,
                rows=method_rows(settings, verdict, files)),
    ]  # fmt: skip


def condition_rows(statement: Statement, verdict: Verdict) -> list[list[str]]:
    """Return the ambient conditions stated by the user, and the temperature in the data."""
    rows = []
    for name, (words, unit) in CONDITIONS.items():
        bounds = getattr(statement, name)
        rows.append([words, f"{bounds[0]:g} to {bounds[1]:g} {unit}" if bounds else NOT_STATED])
    between = temperature_range(verdict)
    measured = "not measured" if between is None else f"{between[0]:.2f} to {between[1]:.2f} °C"
    rows.append(["temperature in the data", measured])
    return [*rows, ["remarks", statement.remarks or NOT_STATED]]


def temperature_range(verdict: Verdict) -> tuple[float, float] | None:
    data = verdict.fitted
    if data.temperature is None or data.clock is None:
        return None
    above = data.clock[:, 1]
    return float(data.temperature + above.min()), float(data.temperature + above.max())


def reference_rows(uncertainties: tuple[float, ...]) -> list[list[str]]:
    return [
        [axis, f"{value * unit_of(axis).fine_factor:.3g} {unit_of(axis).fine_unit}"
               if np.isfinite(value) else "not measured"]
        for axis, value in zip(POSE, uncertainties, strict=True)
    ]  # fmt: skip


def expand(standard: Floats, freedom: Floats) -> tuple[Floats, list[str], list[str]]:
    """Return expanded uncertainties for 95 %, shaped like `standard`, and two flat lists of
    texts: coverage factors and degrees of freedom. Without freedom the factor is the normal
    distribution's."""
    factor = coverage_factor(budgets.COVERAGE, freedom)
    counts = [f"{value:.0f}" if value < 1e4 else "∞" for value in freedom.ravel().tolist()]
    return factor * standard, [f"{value:.2f}" for value in factor.ravel().tolist()], counts


def coverage_words() -> str:
    return (
        f"U = k u is the expanded uncertainty for a coverage probability of "
        f"{100 * budgets.COVERAGE:.0f} %: u is the standard uncertainty, k follows from "
        "Student's t with the effective degrees of freedom (dof)."
    )


def parameter_section(verdict: Verdict, budget: Budget, made: Sensor) -> ReportSection:
    assert verdict.fit is not None
    assert verdict.search is not None
    table = parameter_table(verdict.search.sensor, verdict.fit, made)
    columns = [table[name].tolist() for name in ("parameter", "unit", "value", "change")]
    variances = {source: np.diag(part)[table["place"]] for source, part in budget.sensor.items()}
    expanded, factors, freedom = expand(table["u"], budget.effective_freedom(variances))
    rows = []
    for (name, unit, value, change), size, factor, count in zip(
        zip(*columns, strict=True), expanded.tolist(), factors, freedom, strict=True
    ):
        both = (round_to(number, size) for number in (value, change, size))
        rows.append([name, *both, write_micro(unit), factor, count])
    words = (coverage_words(), "Change: value less that of the configuration.")
    headings = ("parameter", "value", "change", "U", "unit", "k", "dof")
    return ReportSection("Parameters", words, headings, rows, wide=True)


def pose_section(budget: Budget, parts: dict[str, Floats]) -> ReportSection:
    """State the expanded uncertainty of poses by the calibration, um and urad, at rest and over its
    samples. parts: variances (n, 6) of the pose by source, mm^2 and rad^2; the first row is that at
    rest."""
    standard = np.sqrt(np.asarray(sum(parts.values())))
    freedom = budget.effective_freedom(parts)
    units = np.array([unit_of(axis).fine_factor for axis in POSE])
    expanded, factors, counts = expand(standard * units, freedom)  # those at rest come first
    largest = np.nanmax(expanded, axis=0)
    rows = [
        [axis, f"{expanded[0, n]:.2g}", f"{largest[n]:.2g}", unit_of(axis).fine_unit, factors[n],
         counts[n]]
        for n, axis in enumerate(POSE)
    ]  # fmt: skip
    words = (
        "Caused by the calibration alone, with the knowledge of the beam that the written "
        "configuration states (block solve). A mean of many samples does not reduce it.",
    )
    headings = ("axis", "U at rest", "largest U", "unit", "k at rest", "dof")
    return ReportSection("Uncertainty of poses, caused by the calibration", words, headings, rows)


def budget_rows(parts: dict[str, Floats]) -> list[list[str]]:
    total = np.asarray(sum(parts.values()))[0]
    rows = [
        [source, *(f"{percent:.1f}" for percent in (100 * part[0] / total).tolist())]
        for source, part in parts.items()
    ]
    units = [(unit_of(axis).fine_factor, unit_of(axis).fine_unit) for axis in POSE]
    sizes = [f"{np.sqrt(v) * by:.3g} {unit}" for v, (by, unit) in zip(total, units, strict=True)]
    return [*rows, ["standard uncertainty u", *sizes]]


def error_rows(errors: dict[str, Any] | None) -> list[list[str]]:
    assert errors is not None
    return [
        [axis, f"{robust:.3g}", f"{stated:.3g}", unit.replace("u", MICRO, 1), f"{inside:.1f}"]
        for axis, unit, _, after, robust, stated, inside, _ in zip(*errors.values(), strict=True)
        if after == after
    ]


def correlations(covariance: Floats) -> Floats:
    """Return the coefficients of a covariance, 0 for a quantity without variance."""
    sizes = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        matrix: Floats = np.nan_to_num(covariance / np.outer(sizes, sizes))
    return matrix


def pose_correlations(covariances: dict[str, Floats]) -> list[list[str]]:
    matrix = correlations(np.asarray(sum(covariances.values()))[0])
    return [
        [
            axis,
            *(f"{round(value, 2) + 0.0:.2f}" for value in row[: n + 1]),
            *[""] * (len(POSE) - n - 1),
        ]
        for n, (axis, row) in enumerate(zip(POSE, matrix.tolist(), strict=True))
    ]


def correlation_section(calibrated: Config) -> ReportSection:
    """List the strongest correlations of parameters."""
    calibration = calibrated.sensor.calibration
    assert calibration is not None
    names, matrix = calibration.names, correlations(np.array(calibration.covariance))
    upper = np.triu(np.abs(matrix), 1)
    pairs = np.argwhere(upper >= LEAST_CORRELATION)
    pairs = pairs[np.argsort(-upper[tuple(pairs.T)])]
    rows = [[names[i], names[j], f"{matrix[i, j]:+.3f}"] for i, j in pairs[:MOST_PAIRS]]
    words = (
        f"{len(pairs)} of {len(names) * (len(names) - 1) // 2} pairs of the written "
        f"parameters have a coefficient of {LEAST_CORRELATION} or more; the strongest "
        f"{len(rows)} are listed. The table of the whole covariance is a file of the result.",
    )
    headings = ("parameter", "with", "coefficient")
    return ReportSection("Correlations of parameters", words, headings, rows)


def range_rows(
    verdict: Verdict, states: Floats, stated: tuple[float, float] | None
) -> list[list[str]]:
    """Return the ranges of the fitted samples' poses, beam positions and temperature.

    stated: the user's range of temperature, for data that have none.
    """
    rows = []
    for n, axis in enumerate((*POSE, "bx", "by")):
        unit = unit_of(axis)
        low, high = (f(states[:, n]) * unit.factor for f in (np.min, np.max))
        rows.append([axis, f"{low:.4g}", f"{high:.4g}", unit.unit])
    between = temperature_range(verdict) or stated
    ends = [NOT_STATED] * 2 if between is None else [f"{value:.2f}" for value in between]
    return [*rows, ["temperature", *ends, "°C"]]


def method_rows(settings: Config, verdict: Verdict, files: ReportFiles) -> list[list[str]]:
    assert verdict.fit is not None
    assert verdict.search is not None
    fit, origin = verdict.fit, provenance_header(settings)
    effects = [row.words for row in verdict.search.rows if row.accepted]
    about = [
        ["method", "weighted least squares over all readings (bundle adjustment), "
                   f"{len(fit.choice.names)} unknowns, {len(verdict.fitted.raw)} samples fitted, "
                   f"{len(verdict.held.raw)} checked"],
        ["chi-square per degree of freedom",
         f"{fit.reduced_chi_square:.3f} with {fit.freedom:.0f} degrees of freedom; 1 is expected"],
        ["effects that the data require", ", ".join(effects) or "none"],
        ["configuration", f"{settings.name}, sha256 {settings.sha256}"],
        ["page made", origin["made"]],
        ["software", f"facets {__version__}, Python {platform.python_version()}"],
    ]  # fmt: skip
    sums = [
        [f"{kind}: {path.name}", f"sha256 {sha256(path.read_bytes()).hexdigest()}"]
        for kind, paths in (("read", files.sources), ("written", files.results))
        for path in paths
    ]
    return [*about, *sums]
