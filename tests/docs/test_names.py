"""What the documentation names in code exists: identifiers, files, and both where it puts them."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from pkgutil import resolve_name

import pytest
from pages import LINK, PAGES, ROOT, name_of, prose

from facets.core import STATE_COLUMNS

FOLDERS = ("facets", "cli", "experiments", "configs", "tests", "docs")
WORD = re.compile(r"[A-Za-z_]\w*")
SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
FILE = re.compile(r"\.(bin|csv|html|json|md|parquet|png|py|yaml)$")
#: Names of other packages and programs, of a reader's own code, and of the fields of a frame.
ELSEWHERE = {
    "aligned", "bps", "collect_while_completing", "fromfile", "git", "make", "open_daq", "t_us",
}  # fmt: skip
#: What columns of objects, displacements and covariances begin with.
OBJECTS = (
    f"{what}{whose}"
    for what in ("", "true_", "u_", "u_noise_", "u_calibration_")
    for whose in ("object", "displacement")
)
#: Columns that the code puts together.
COLUMNS = {
    f"{what}_{name}"
    for what in (
        "ref",
        "u",
        "u_noise",
        "u_calibration",
        "smooth",
        "smooth_object",
        "expanded",
        *OBJECTS,
    )
    for name in (*STATE_COLUMNS, "")
} | {f"{what}_{letter}" for what in ("psi", "zeta", "power") for letter in "abc"}
COLUMNS |= {f"{what}_{end}" for what in ("k", "degrees_of_freedom") for end in ("tx", "at_rest")}
COLUMNS |= {"symmetric_low", "shortest_high"}
COLUMNS |= {f"{what}_{place}" for what in ("expanded", "k") for place in ("at_rest", "worst")}
COLUMNS |= {
    f"cov_{whose}{name}"
    for whose in ("", "object_", "displacement_")
    for name in ("tx_tx_mm2", "tx_roll_mm_mrad", "tx_pitch_mm_mrad", "yaw_yaw_mrad2")
}


@cache
def files():
    inside = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
    kept = [path for path in inside if "__pycache__" not in path.parts and ".min." not in path.name]
    return [ROOT / "Makefile", ROOT / "pyproject.toml", *(set(kept) - {Path(__file__)})]


def python_names(source):
    """All names of a Python file, and the words of its short texts: keys, columns, options."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.arg | ast.keyword):
            yield node.arg or ""
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.alias):
            yield from node.name.split(".")
        elif isinstance(node, ast.Constant) and isinstance(node.value, str | bytes):
            text = node.value if isinstance(node.value, str) else node.value.decode("latin-1")
            yield from WORD.findall(text) if len(text) < 60 else ()


@cache
def names_in(path):
    """The names of a source file; of a folder, those of its files, and the files' own."""
    if path.is_dir():
        inside = [file for file in files() if file.is_relative_to(path)]
        return frozenset().union(*map(names_in, inside))
    own = {path.stem, path.parent.name}
    if path.suffix == ".py":
        return frozenset(own | set(python_names(path.read_text("utf-8"))))
    if path.suffix in (".c", ".h", ".ino", ".js", ".yaml", ".toml") or path.name == "Makefile":
        return frozenset(own | set(WORD.findall(path.read_text("utf-8"))))
    return frozenset(own)


@cache
def all_names():
    return frozenset(ELSEWHERE | COLUMNS).union(*map(names_in, files()))


def identifiers(text):
    """The names in the code spans of a text that are one name, dotted or called; files are not."""
    spans = (re.fullmatch(r"([A-Za-z_][\w.]*?)(\(.*\))?", span) for span in SPAN.findall(text))
    names = [span[1] for span in spans if span and not FILE.search(span[0])]
    return {part for name in names for part in name.strip(".").split(".")}


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_names_in_the_text_exist(page):
    assert identifiers(prose(page)) - all_names() == set()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_in_the_text_exist(page):
    present = {path.name for path in files()}
    for span in SPAN.findall(prose(page)):
        if re.fullmatch(rf"({'|'.join(FOLDERS)})/[\w./-]*", span):
            assert (ROOT / span).exists(), span
        elif re.fullmatch(r"[\w-]+\.(py|c|ino|js)", span):
            assert span in present, span


def places():
    """Rows and paragraphs of CONTRIBUTING that say what goes into which file of the code."""
    _, _, where = prose(ROOT / "CONTRIBUTING.md").partition("## Where a new detector goes")
    text, _, _ = where.partition("\n## Documentation")
    parts = [row for row in text.splitlines() if row.startswith("| ")]
    parts += [part for part in text.split("\n\n") if not part.startswith(("|", "#"))]
    return [part for part in parts if LINK.search(part)]


@pytest.mark.slow
@pytest.mark.parametrize("place", places())
def test_what_to_change_stands_in_the_file_that_is_named(place):
    linked = [ROOT / link.partition("#")[0] for link in LINK.findall(place)]
    known = frozenset().union(*map(names_in, linked))
    assert identifiers(place) - known == set()


@pytest.mark.slow
def test_a_name_that_does_not_exist_is_found():
    assert identifiers("`electrode_pairs`, `a.b`, `f(x)` and `two words`") == {
        "electrode_pairs", "a", "b", "f",
    }  # fmt: skip
    assert "electrode_pairs" not in all_names()


def test_the_names_of_the_reference_can_be_imported():
    """The build of the documentation would find this too, a quarter of an hour later."""
    text = (ROOT / "docs/api.md").read_text("utf-8")
    names = re.findall(r"^::: (\S+)", text, flags=re.MULTILINE)
    assert len(names) > 20
    for name in names:
        resolve_name(name)
