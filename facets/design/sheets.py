"""Tables of a design for documents: LaTeX, or a workbook."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..core.errors import InputError
from ..core.extras import require_extra
from ..files.tables import Whole

#: Headings and rows of a table.
Rows = tuple[Sequence[str], Sequence[Sequence[str]]]
KINDS = (".tex", ".xlsx")
#: The largest length of a sheet's name in a workbook, and the characters that it excludes.
MAX_SHEET_NAME, NOT_IN_SHEET_NAME = 31, re.compile(r"[\[\]:*?/\\]")


def require_writable(path: Path) -> None:
    """Raise `InputError` if tables cannot be written to a file with this suffix."""
    if path.suffix.lower() not in KINDS:
        raise InputError(f"{path}: tables are written as {' or '.join(KINDS)}")
    if path.suffix.lower() == ".xlsx":
        require_extra("openpyxl", str(path))


def write_sheets(path: Path, tables: dict[str, Rows], origin: str) -> None:
    """Write tables by their titles.  origin: one line that states how they were made.

    LaTeX: one `table` after the other, for the package booktabs.  A workbook: a sheet each, with
    numbers as numbers, and a last sheet with the origin.
    """
    with Whole(path) as temporary:
        if path.suffix.lower() == ".tex":
            texts = [as_latex(title, *rows) for title, rows in tables.items()]
            temporary.write_text(
                "\n".join([f"% {origin}", "% \\usepackage{booktabs}", *texts]), "utf-8"
            )
        else:
            write_workbook(temporary, tables, origin)


def as_latex(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table with a caption; the first column is text, as are columns without a number."""
    columns = "".join("l" if is_text(column) else "r" for column in zip(*rows, strict=True))
    lines = [" & ".join(map(escape_text, row)) + r" \\" for row in (headings, *rows)]
    return "\n".join(
        [
            r"\begin{table}",
            rf"\caption{{{escape_text(title)}}}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            lines[0],
            r"\midrule",
            *lines[1:],
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def is_text(column: Sequence[str]) -> bool:
    """Return whether a column has text: a cell that is not a number, with or without a unit."""
    return any(cell and number(cell.removesuffix(" %")) is None for cell in column)


def number(cell: str) -> float | None:
    with suppress(ValueError):
        return float(cell)
    return None


#: Characters with a special meaning in LaTeX.
LATEX_ESCAPES = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "µ": r"\textmu{}", "²": r"\textsuperscript{2}",
}  # fmt: skip


def escape_text(text: str) -> str:
    return "".join(LATEX_ESCAPES.get(character, character) for character in text)


def write_workbook(path: Path, tables: dict[str, Rows], origin: str) -> None:
    from openpyxl import Workbook
    from openpyxl.styles import Font

    book = Workbook()
    book.remove(book.active)
    for title, (headings, rows) in tables.items():
        sheet: Any = book.create_sheet(NOT_IN_SHEET_NAME.sub(" ", title)[:MAX_SHEET_NAME])
        sheet.append(list(headings))
        for row in rows:
            sheet.append([cell if (n := number(cell)) is None else n for cell in row])
        for cell in sheet[1]:
            cell.font = Font(bold=True)
        for column in sheet.columns:
            width = max(len(str(cell.value)) for cell in column)
            sheet.column_dimensions[column[0].column_letter].width = width + 2
        sheet.freeze_panes = "A2"
    book.create_sheet("how it was made").append([origin])
    book.save(path)
