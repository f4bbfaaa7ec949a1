"""Tables of a design as a person puts them into a document: LaTeX, or a workbook."""

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
#: What a workbook takes as a sheet's name: 31 characters, and none of these.
LONGEST, FORBIDDEN = 31, re.compile(r"[\[\]:*?/\\]")


def require_writable(path: Path) -> None:
    """Raises `InputError` where tables of that kind cannot be written."""
    if path.suffix.lower() not in KINDS:
        raise InputError(f"{path}: tables are written as {' or '.join(KINDS)}")
    if path.suffix.lower() == ".xlsx":
        require_extra("openpyxl", str(path))


def write_sheets(path: Path, tables: dict[str, Rows], origin: str) -> None:
    """Writes tables by their titles.  origin: how they were made, in one line.

    LaTeX: one `table` after the other, for the package booktabs.  A workbook: a sheet each, numbers
    as numbers, and a last one that says how they were made.
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
    """A table with a caption; the first column is words, as are those without a number."""
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
    """Whether a column has words: anything that is no number, but for a unit behind one."""
    return any(cell and number(cell.removesuffix(" %")) is None for cell in column)


def number(cell: str) -> float | None:
    with suppress(ValueError):
        return float(cell)
    return None


#: What LaTeX would take for something else.
SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "µ": r"\textmu{}", "²": r"\textsuperscript{2}",
}  # fmt: skip


def escape_text(text: str) -> str:
    return "".join(SPECIAL.get(character, character) for character in text)


def write_workbook(path: Path, tables: dict[str, Rows], origin: str) -> None:
    from openpyxl import Workbook
    from openpyxl.styles import Font

    book = Workbook()
    book.remove(book.active)
    for title, (headings, rows) in tables.items():
        sheet: Any = book.create_sheet(FORBIDDEN.sub(" ", title)[:LONGEST])
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
