"""Run experiments and compare their results with stored references: `facets reproduce`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import facets
from facets.core.errors import InputError
from facets.core.plain_numbers import suggest_name
from facets.files import provenance
from facets.files.tables import write_table
from facets.files.whole import readable_path
from facets.pictures import style

from .paper.experiment import EXPERIMENTS, Experiment, PaperClaim, Table, experiment

EXPECTED = Path(__file__).parent / "expected"


@dataclass(frozen=True)
class Check:
    """The comparison of one column with its reference.

    off: the largest difference over the allowed one; 1 or less repeats the reference, NaN if rows
    or words differ.  allowed: the allowed difference in words.  why: the reason for it.
    """

    column: str
    off: float
    allowed: str
    why: str

    @property
    def repeats(self) -> bool:
        """Whether the column repeats its reference; False for NaN."""
        return self.off <= 1


@dataclass(frozen=True)
class ExperimentResult:
    """The results of an experiment.

    table, picture: files; picture is None for an experiment without one.  An experiment repeats if
    its numbers are those of the stored references, which this project made. Whether they agree with
    the paper is a different question, which each claim answers.
    """

    name: str
    title: str
    config: str
    claims: list[PaperClaim]
    checks: list[Check]
    table: Path
    picture: Path | None
    seconds: float

    @property
    def repeats(self) -> bool:
        """Return whether every column equals that of the stored reference."""
        return all(check.repeats for check in self.checks)

    @property
    def agreement(self) -> tuple[int, int]:
        """Count the paper's results that are met within 10 %, and all of its results."""
        verdicts = [claim.agrees for claim in self.claims if claim.agrees is not None]
        return sum(verdicts), len(verdicts)


def select_experiments(names: list[str]) -> list[str]:
    """Select experiments by name, in order; all of them for no name or `all`. Raises `InputError`
    for an unknown name."""
    unknown = [name for name in names if name not in (*EXPERIMENTS, "all")]
    if unknown:
        raise InputError(
            f"unknown experiment {', '.join(unknown)}; allowed: {', '.join(EXPERIMENTS)}, all"
            f"{suggest_name(unknown[0], EXPERIMENTS)}"
        )
    if not names or "all" in names:
        return list(EXPERIMENTS)
    return [name for name in EXPERIMENTS if name in names]


def reproduce(names: list[str], quick: bool, folder: Path) -> Iterator[ExperimentResult]:
    """Run each experiment in turn, and write its files into the folder."""
    for name in names:
        start = time.perf_counter()
        work = experiment(name)
        path = folder / f"{name}.csv"
        table = compute_table(work, quick, path)
        claims = work.claims(table)
        drawing = work.picture(table)
        picture = None
        if drawing is not None:
            picture = folder / f"{name}.svg"
            style.save(drawing, picture)
        checks = check_columns(name, quick, table, claims)
        seconds = time.perf_counter() - start
        yield ExperimentResult(
            name, work.TITLE, work.CONFIG, claims, checks, path, picture, seconds
        )


def compute_table(work: Experiment, quick: bool, path: Path) -> Table:
    """Compute the table and read it back from its file, so that figures use the written one."""
    write_table(path, work.compute(quick), provenance.provenance_header(facets.load(work.CONFIG)))
    return read(readable_path(path))


def read(path: Path) -> Table:
    """Read a table of numbers and words; an empty cell is a word."""
    import pandas as pd

    frame = pd.read_csv(path, comment="#")
    words = [name for name in frame if not pd.api.types.is_numeric_dtype(frame[name])]
    frame = frame.fillna(dict.fromkeys(words, ""))
    return {str(name): frame[name].to_numpy() for name in frame.columns}


def claim_table(claims: list[PaperClaim]) -> Table:
    """The claims as a table."""
    return {
        "what": np.array([claim.what for claim in claims]),
        "unit": np.array([claim.unit for claim in claims]),
        "paper": np.array([float(claim.paper) for claim in claims]),
        "ours": np.array([float(claim.ours) for claim in claims]),
    }


def reference_path(name: str, quick: bool, kind: str) -> Path:
    """Path of the reference, of the quick run if its numbers differ."""
    short = EXPECTED / "quick" / f"{name}-{kind}.csv"
    return short if quick and short.exists() else EXPECTED / f"{name}-{kind}.csv"


def tolerances() -> dict[str, Any]:
    """Read the tolerances by experiment, kind of table (claims, table) and column. Each has
    `why`; `rel`, a fraction, and `abs`, in the column's unit, are 0 if absent."""
    from ruamel.yaml import YAML

    rules: dict[str, Any] = YAML(typ="safe").load(EXPECTED / "tolerances.yaml")
    return rules


def check_columns(name: str, quick: bool, table: Table, claims: list[PaperClaim]) -> list[Check]:
    """Compare every column that the tolerances name with its reference. A missing column or
    reference gives a check that fails (`off` is NaN)."""
    checks = []
    for kind, columns in tolerances()[name].items():
        actual = table if kind == "table" else claim_table(claims)
        path = reference_path(name, quick, kind)
        expected = read(path) if path.exists() else {}
        checks += [check_column(column, actual, expected, rule) for column, rule in columns.items()]
    return checks


def check_column(column: str, actual: Table, expected: Table, rule: dict[str, Any]) -> Check:
    """Compare one column with its reference. rule: entry of the tolerances with `rel`, `abs` and
    `why`."""
    rel, absolute = float(rule.get("rel", 0)), float(rule.get("abs", 0))
    parts = [f"{rel:g} of it"] * bool(rel) + [f"{absolute:g}"] * bool(absolute)
    allowed = " and ".join(parts) or "the same"
    return Check(column, distance(column, actual, expected, rel, absolute), allowed, rule["why"])


def distance(column: str, actual: Table, expected: Table, rel: float, absolute: float) -> float:
    """Largest difference over the allowed one; NaN if a column is missing, or if rows or words
    differ."""
    if column not in actual or column not in expected:
        return np.nan
    ours, theirs = actual[column], expected[column]
    if len(ours) != len(theirs):
        return np.nan
    if "what" in actual and actual["what"].tolist() != expected["what"].tolist():
        return np.nan
    if ours.dtype.kind not in "biuf" or theirs.dtype.kind not in "biuf":
        return 0.0 if (ours == theirs).all() else np.nan
    ours, theirs = ours.astype(float), theirs.astype(float)
    same = (ours == theirs) | (np.isnan(ours) & np.isnan(theirs))
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.where(same, 0.0, np.abs(ours - theirs) / (absolute + rel * np.abs(theirs)))
    return float(off.max(initial=0.0))


def write_references(quick: bool, folder: Path) -> None:
    """Write new references from a new run, for a commit that says why they changed."""
    rules = tolerances()
    for result in reproduce(list(EXPERIMENTS), quick, folder):
        if quick and result.repeats:
            continue  # the references of the full run apply
        about = provenance.provenance_header(facets.load(result.config))
        kinds = {"claims": claim_table(result.claims), "table": read(readable_path(result.table))}
        for kind in rules[result.name]:
            path = EXPECTED / ("quick" if quick else "") / f"{result.name}-{kind}.csv"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_table(path, kinds[kind], {key: about[key] for key in ("config", "config_sha256")})


if __name__ == "__main__":
    import tempfile

    for short in (False, True):
        with tempfile.TemporaryDirectory() as scratch:
            write_references(short, Path(scratch))
