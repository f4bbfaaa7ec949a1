"""Build the package, install it outside of the checkout, and test it there.

    python tests/helpers/installed.py [--lowest | --only-build FOLDER]

Builds a wheel of the files that git knows, a source distribution, and a wheel of that, and compares
what they hold. Installs the wheel without extras into a fresh environment in a temporary folder
whose path has spaces, and runs there the tests that are marked `plain`; then with its extras into
another one, for those that are marked `wheel` or `installed`.

--only-build: leaves the source distribution and the wheel in a folder, and tries nothing.
--lowest: with the oldest versions that `pyproject.toml` allows instead of the newest; a bound that
cannot be had as it is written ends this. Without the tests that are marked `slow`, for time.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[2]
UV = Path(sys.executable).with_name("uv")
#: Folders whose files are installed, and where.
PACKAGES = {
    "facets": "facets",
    "cli": "facets/cli",
    "experiments": "facets/experiments",
    "configs": "facets/configs",
}
#: Studies that no command needs: they stand beside the tests of an installed package.
STUDIES = "experiments/studies/"
#: The environments: name, extras, and marks of the tests that run there. `stages` has the peers of
#: virtual stages.
ENVIRONMENTS = (
    ("plain", (), ("plain",)),
    ("whole", ("all", "stages"), ("installed", "wheel")),
)
PYTEST = ("-n", "auto", "--dist", "worksteal", "--durations=12")


def run(*words: str | Path, cwd: Path) -> None:
    """Run a command; if it fails, print its output and end this process."""
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{done.stdout}{done.stderr}\nfailed: {' '.join(map(str, words))}")


def known_files() -> list[str]:
    """List the files of the checkout, including uncommitted ones."""
    asked = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    text = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [name for name in text.split("\0") if name and (ROOT / name).is_file()]


def copy_files(names: Sequence[str], folder: Path) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    return folder


def package_files(names: Sequence[str]) -> set[str]:
    """Where the files of the packages must lie in a wheel."""
    placed = set()
    for name in names:
        top, _, rest = name.partition("/")
        if top in PACKAGES and rest and not name.startswith(STUDIES):
            placed.add(f"{PACKAGES[top]}/{rest}")
    return placed


def wheel_files(wheel: Path) -> dict[str, bytes]:
    """Read the packages' files in a wheel, without the wheel's metadata."""
    with zipfile.ZipFile(wheel) as archive:
        return {
            name: archive.read(name)
            for name in archive.namelist()
            if not name.split("/")[0].endswith(".dist-info")
        }


def compare(wheel: Path, from_sdist: Path, names: Sequence[str]) -> None:
    """End this process if the wheel lacks a file or has one too many."""
    held, expected = wheel_files(wheel), package_files(names)
    faults = [
        *(f"not in the wheel: {name}" for name in sorted(expected - set(held))),
        *(f"in the wheel, but no file of the packages: {name}" for name in set(held) - expected),
    ]
    if held != wheel_files(from_sdist):
        faults.append("the wheel that is made of the source distribution differs")
    if faults:
        raise SystemExit("\n".join([*faults, "see [tool.setuptools] in pyproject.toml"]))


def build(names: Sequence[str], folder: Path) -> Path:
    """Build the wheel and compare its files with the expected ones."""
    source = copy_files(names, folder / "source tree")
    run(UV, "build", "--out-dir", folder / "from sdist", source, cwd=folder)
    run(UV, "build", "--wheel", "--out-dir", folder / "wheel", source, cwd=folder)
    (wheel,), (from_sdist,) = ((folder / f).glob("*.whl") for f in ("wheel", "from sdist"))
    compare(wheel, from_sdist, names)
    return wheel


def environment(
    wheel: Path, settings: dict[str, Any], folder: Path, extras: Sequence[str], lowest: bool
) -> Path:
    """Install the wheel in a fresh environment, compiled as by pip; return its program folder."""
    project, tools = settings["project"], settings["dependency-groups"]["test"]
    asked = [f"{project['name']}[{','.join(extras)}] @ {wheel.as_uri()}", *tools]
    if lowest:
        needed = [*tools, *project["dependencies"], *needed_by(extras, project)]
        asked = [asked[0], *map(at_its_bound, needed)]
    run(UV, "venv", "--quiet", "--python", sys.executable, folder, cwd=folder.parent)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    resolution = ["--resolution", "lowest-direct"] if lowest else []
    run(
        UV, "pip", "install", "--quiet", "--compile-bytecode", "--python", programs / "python",
        *resolution, *asked, cwd=folder,
    )  # fmt: skip
    return programs


def needed_by(extras: Iterable[str], project: dict[str, Any]) -> Iterator[str]:
    """List what extras need, and the extras of the project that they bring."""
    for text in (text for name in extras for text in project["optional-dependencies"][name]):
        requirement = Requirement(text)
        if requirement.name == project["name"]:
            yield from needed_by(requirement.extras, project)
        else:
            yield text


def at_its_bound(text: str) -> str:
    """What only the lowest version meets, or one that extends it (4.2.0.1 for the bound 4.2)."""
    requirement = Requirement(text)
    for each in requirement.specifier:
        if each.operator == ">=":
            requirement.specifier = SpecifierSet(f"=={each.version}.*")
    return str(requirement)


def marked_files(folder: Path, marks: Sequence[str]) -> list[str]:
    """List the files with a marked test; other files may need more than the group `test`."""
    files = sorted((folder / "tests").rglob("test_*.py"))
    marked = re.compile(rf"pytest\.mark\.({'|'.join(marks)})\b")
    return [str(file.relative_to(folder)) for file in files if marked.search(file.read_text())]


def main(arguments: Sequence[str]) -> int:
    lowest = "--lowest" in arguments
    names = known_files()
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    with tempfile.TemporaryDirectory(prefix="facets installed ") as temporary:
        folder = Path(temporary)
        if arguments[:1] == ["--only-build"]:
            target = ROOT / arguments[1]
            target.mkdir(parents=True)  # what was built before is not mixed with this
            for built in (build(names, folder), *folder.glob("from sdist/*.tar.gz")):
                print(shutil.copy(built, target))
            return 0
        wheel = build(names, folder)
        beside = [
            name for name in names
            if name.split("/")[0] not in PACKAGES or name.startswith(STUDIES)
        ]  # fmt: skip
        tests = copy_files([*beside, "experiments/README.md"], folder / "no checkout")
        words = [argument for argument in arguments if argument != "--lowest"]
        if lowest:  # what they bring beside themselves is newer than they know
            words += ["-W", "default::DeprecationWarning"]
        environment_variables = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        for name, extras, marks in ENVIRONMENTS:
            programs = environment(wheel, settings, folder / f"a {name} one", extras, lowest)
            chosen = f"({' or '.join(marks)}){'' if name == 'plain' else ' and not plain'}"
            chosen += " and not slow" * lowest
            done = subprocess.run(
                [programs / "pytest", *PYTEST, "-m", chosen, *marked_files(tests, marks), *words],
                cwd=tests, env=environment_variables, check=False,
            )  # fmt: skip
            if done.returncode:
                return done.returncode
        return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
