"""What the documentation names in code exists: identifiers and files."""

import io
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest
from pages import PAGES, ROOT, name_of, prose

from facets.core import STATE_COLUMNS

FOLDERS = ("facets", "cli", "experiments", "configs", "tests", "docs")
WORD = re.compile(r"[A-Za-z_]\w*")
SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
FILE = re.compile(r"\.(bin|csv|html|json|md|parquet|png|py|yaml)$")
#: Names of other packages and programs, of a reader's own code, and of the fields of a frame.
ELSEWHERE = {
    "aligned", "bps", "collect_while_completing", "fish", "fromfile", "git", "h5read", "make",
    "merge_asof", "open_daq", "t_us", "zsh",
}  # fmt: skip
#: Columns whose names the code puts together.
COLUMNS = re.compile(
    r"(ref|u|u_noise|u_calibration|expanded"
    r"|(true_|u_|u_noise_|u_calibration_)?(object|displacement))"
    rf"_({'|'.join(STATE_COLUMNS)})?"
    r"|(psi|zeta|power)_[abc]|(k|degrees_of_freedom)_(tx|at_rest)|symmetric_low|shortest_high"
    r"|(expanded|k)_(at_rest|worst)"
    r"|cov_(object_|displacement_)?(tx_tx_mm2|tx_(roll|pitch)_mm_mrad|yaw_yaw_mrad2)"
    r"|cov_(object|displacement)"
    r"|density_(10mhz|1hz|100hz)_per_rthz|allan_(1|100|1000)s"
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


def names_in(path):
    """The names of a source file, and its own."""
    names = {path.stem, path.parent.name}
    if path.suffix == ".py":
        names.update(python_names(path.read_text("utf-8")))
    elif path.suffix in (".c", ".h", ".ino", ".js", ".yaml", ".toml") or path.name == "Makefile":
        names.update(WORD.findall(path.read_text("utf-8")))
    return names


@cache
def all_names():
    return ELSEWHERE.union(*map(names_in, files()))


def unknown(text):
    return {name for name in identifiers(text) - all_names() if not COLUMNS.fullmatch(name)}


def identifiers(text):
    """The names in the code spans of a text that are one name, dotted or called; files are not."""
    spans = (re.fullmatch(r"([A-Za-z_][\w.]*?)(\(.*\))?", span) for span in SPAN.findall(text))
    names = [span[1] for span in spans if span and not FILE.search(span[0])]
    return {part for name in names for part in name.strip(".").split(".")}


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_names_in_the_text_exist(page):
    assert unknown(prose(page)) == set()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_in_the_text_exist(page):
    present = {path.name for path in files()}
    for span in SPAN.findall(prose(page)):
        if re.fullmatch(rf"({'|'.join(FOLDERS)})/[\w./-]*", span):
            assert (ROOT / span).exists(), span
        elif re.fullmatch(r"[\w-]+\.(py|c|ino|js)", span):
            assert span in present, span


@pytest.mark.slow
def test_a_name_that_does_not_exist_is_found():
    assert identifiers("`electrode_pairs`, `a.b`, `f(x)` and `two words`") == {
        "electrode_pairs", "a", "b", "f",
    }  # fmt: skip
    assert unknown("`electrode_pairs` and `u_noise_tx_mm`") == {"electrode_pairs"}
