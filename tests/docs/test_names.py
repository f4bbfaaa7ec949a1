"""What the documentation names in code exists: identifiers, files, and both where it puts them."""

import io
import re
import tokenize
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
#: Columns whose names the code puts together.
COLUMNS = re.compile(
    r"(ref|u|u_noise|u_calibration|smooth|smooth_object|expanded"
    r"|(true_|u_|u_noise_|u_calibration_)?(object|displacement))"
    rf"_({'|'.join(STATE_COLUMNS)})?"
    r"|(psi|zeta|power)_[abc]|(k|degrees_of_freedom)_(tx|at_rest)|symmetric_low|shortest_high"
    r"|(expanded|k)_(at_rest|worst)"
    r"|cov_(object_|displacement_)?(tx_tx_mm2|tx_(roll|pitch)_mm_mrad|yaw_yaw_mrad2)"
)


@cache
def files():
    inside = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()]
    kept = [path for path in inside if "__pycache__" not in path.parts and ".min." not in path.name]
    return [ROOT / "Makefile", ROOT / "pyproject.toml", *(set(kept) - {Path(__file__)})]


def python_names(source):
    """All names of a Python file, and the words of its short texts: keys, columns, options."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.NAME or (is_text(token) and len(token.string) < 60):
            yield from WORD.findall(token.string)


def is_text(token):
    """Whether a token is a text; those with values in braces have a name since Python 3.12."""
    return tokenize.tok_name[token.type] in ("STRING", "FSTRING_MIDDLE")


@cache
def names_in(path):
    """The names of a source file; of a folder, those of its files, and the files' own."""
    if path.is_dir():
        return frozenset().union(*(names_in(file) for file in files() if path in file.parents))
    names = {path.stem, path.parent.name}
    if path.suffix == ".py":
        names.update(python_names(path.read_text("utf-8")))
    elif path.suffix in (".c", ".h", ".ino", ".js", ".yaml", ".toml") or path.name == "Makefile":
        names.update(WORD.findall(path.read_text("utf-8")))
    return frozenset(names)


@cache
def all_names():
    return frozenset(ELSEWHERE).union(*map(names_in, files()))


def unknown(text, known):
    return {name for name in identifiers(text) - known if not COLUMNS.fullmatch(name)}


def identifiers(text):
    """The names in the code spans of a text that are one name, dotted or called; files are not."""
    spans = (re.fullmatch(r"([A-Za-z_][\w.]*?)(\(.*\))?", span) for span in SPAN.findall(text))
    names = [span[1] for span in spans if span and not FILE.search(span[0])]
    return {part for name in names for part in name.strip(".").split(".")}


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_names_in_the_text_exist(page):
    assert unknown(prose(page), all_names()) == set()


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
    assert unknown(place, known) == set()


@pytest.mark.slow
def test_a_name_that_does_not_exist_is_found():
    assert identifiers("`electrode_pairs`, `a.b`, `f(x)` and `two words`") == {
        "electrode_pairs", "a", "b", "f",
    }  # fmt: skip
    assert unknown("`electrode_pairs` and `u_noise_tx_mm`", all_names()) == {"electrode_pairs"}


def test_the_names_of_the_reference_can_be_imported():
    """The build of the documentation would find this too, a quarter of an hour later."""
    text = (ROOT / "docs/api.md").read_text("utf-8")
    names = re.findall(r"^::: (\S+)", text, flags=re.MULTILINE)
    assert len(names) > 20
    for name in names:
        resolve_name(name)
