"""Changes one operator, number or condition of a package at a time, and runs the package's tests.

    make mutants PACKAGES="detectors config" SAMPLE=30 SEED=1

A study by cosmic-ray, on a copy in build/mutants/PACKAGE. It writes build/mutants/PACKAGE.diff with
each change that the tests of tests/PACKAGE pass: each of them is read, and gets a test, or a reason
why nobody can tell it from the code as it is.
"""

from __future__ import annotations

import argparse
import random
import shutil
import subprocess
import sys
from os import environ
from pathlib import Path

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkResult

ROOT = Path(__file__).parents[2]
COPIES = ROOT / "build" / "mutants"
#: The operator `|` appears in annotations, which are never executed.
SETTINGS = """\
[cosmic-ray]
module-path = "facets/{package}"
timeout = {timeout_s}
excluded-modules = []
test-command = "{python} -m pytest -x -q -p no:cacheprovider -m 'not study and not wheel' {tests}"
[cosmic-ray.distributor]
name = "local"
[cosmic-ray.filters.operators-filter]
exclude-operators = ["core/ReplaceBinaryOperator_BitOr_.*", "core/RemoveDecorator"]
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("packages", nargs="+", help="Folders of facets/.")
    parser.add_argument("--sample", type=int, default=30, help="Number of changes to try in each.")
    parser.add_argument("--seed", type=int, default=1, help="Seed of the choice of changes.")
    parser.add_argument("--tests", nargs="+", help="Instead of the tests in the package's folder.")
    parser.add_argument("--timeout", type=float, default=300.0, help="Of the tests of a change, s.")
    options = parser.parse_args()
    for package in options.packages:
        copy_sources(COPIES / package)
        passed, tried = try_changes(
            package, options.tests or [f"tests/{package}"], options.sample, options.seed,
            options.timeout,
        )  # fmt: skip
        print(f"{package}: the tests pass with {passed} of {tried} changes", flush=True)


def copy_sources(copy: Path) -> None:
    """Copy the files known to git, with cli/ and experiments/ inside the package as installed."""
    shutil.rmtree(copy, ignore_errors=True)
    files = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\0")[:-1]
    for name in files:
        inside = Path(name).parts[0] in ("cli", "experiments", "configs")
        for target in [copy / name, copy / "facets" / name][: 1 + inside]:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, target)


def try_changes(
    package: str, tests: list[str], sample: int, seed: int, timeout_s: float
) -> tuple[int, int]:
    """Return the numbers of undetected changes and of all changes tried."""
    copy = COPIES / package
    settings, session = copy / "study.toml", copy / "study.sqlite"
    text = SETTINGS.format(
        package=package, timeout_s=timeout_s, python=sys.executable, tests=" ".join(tests)
    )
    settings.write_text(text)
    call(copy, "cosmic-ray", "init", settings, session)
    call(copy, "cr-filter-operators", session, settings)
    with use_db(session, WorkDB.Mode.open) as work:
        jobs = sorted(item.job_id for item in work.pending_work_items)
        places = {item.job_id: item for item in work.pending_work_items}
        jobs.sort(key=lambda job: str(places[job].mutations))
        chosen = set(random.Random(seed).sample(jobs, min(sample, len(jobs))))
        work.set_multiple_results(
            [job for job in jobs if job not in chosen], WorkResult(WorkerOutcome.SKIPPED)
        )
    call(copy, "cosmic-ray", "exec", settings, session)
    with use_db(session, WorkDB.Mode.open) as work:
        tried = [result for job, result in work.results if job in chosen]
    survivors = [result for result in tried if result.test_outcome == TestOutcome.SURVIVED]
    (COPIES / f"{package}.diff").write_text("\n".join(str(result.diff) for result in survivors))
    return len(survivors), len(tried)


def call(copy: Path, program: str, *arguments: str | Path) -> None:
    subprocess.run(
        [Path(sys.executable).parent / program, *arguments],
        cwd=copy,
        check=True,
        # byte code of one change could pass for the next, if both come within a second
        env={**environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"},
    )


if __name__ == "__main__":
    main()
