"""Tables of a design for documents: LaTeX that is whole, and a workbook that opens."""

from __future__ import annotations

import re

import pytest

from facets.design import write_sheets

TABLES = {
    "Before & after": (["quantity", "before"], [["u_tx_um", "3.88"], ["range_tx_mm", "0.359"]]),
    "Yield": (["heads", "95 % interval"], [["spots, µm²", "55.8 to 78.7 %"]]),
}


@pytest.mark.installed
def test_latex_escapes_what_it_would_take_for_something_else(tmp_path):
    write_sheets(tmp_path / "t.tex", TABLES, "facets optimize layout")
    text = (tmp_path / "t.tex").read_text()
    assert r"\caption{Before \& after}" in text
    assert r"u\_tx\_um & 3.88 \\" in text
    assert r"\begin{tabular}{lr}" in text
    assert r"95 \% interval" in text
    assert text.count(r"\begin{table}") == text.count(r"\end{table}") == 2
    assert not re.search(r"(?<!\\)_", text.split("\n", 2)[2])


@pytest.mark.installed
def test_a_workbook_has_numbers_as_numbers(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    write_sheets(tmp_path / "t.xlsx", TABLES, "facets optimize layout")
    book = openpyxl.load_workbook(tmp_path / "t.xlsx")
    assert book.sheetnames == ["Before & after", "Yield", "how it was made"]
    assert [cell.value for cell in book["Before & after"][2]] == ["u_tx_um", 3.88]
    assert book["how it was made"]["A1"].value == "facets optimize layout"


def test_other_kinds_are_refused(run_in_process, tmp_path):
    status, _, errors = run_in_process("optimize", "layout", "--sheets", "t.docx")
    assert status == 2
    assert ".tex or .xlsx" in errors
    assert not list(tmp_path.iterdir())
