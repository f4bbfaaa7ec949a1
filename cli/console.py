"""Output of the commands: messages, tables that fit the terminal, and bars of progress."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, redirect_stdout
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, TypeVar

import facets
from facets import config as configuration, pictures
from facets.files.whole import STANDARD_STREAM, remove_older, write_text

from . import signals

if TYPE_CHECKING:
    from facets.config import Config

Item = TypeVar("Item")
#: Exit statuses, the same for every command; 130 and 143 are ends by ^C and by SIGTERM.
DONE, FINDING, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
#: The pictures and pages that this command could not draw.
undrawn: list[Path] = []


def message(error: Exception) -> str:
    """Print `error: ...`, with further lines indented."""
    text = str(error)
    if isinstance(error, MemoryError):
        text = "not enough memory; compute less at once"
    elif isinstance(error, OSError):  # a file vanished, or a disk filled up
        about = f"{error.filename}: " if error.filename else ""
        text = f"{about}{error.strerror or error}"
    return "error: " + text.replace("\n", "\n       ")


def load_config(name: str) -> Config:
    """Load a configuration; report which one is used if a shipped name is also that of a file."""
    local = next((f for f in (Path(f"{name}.yaml"), Path(f"{name}.yml")) if f.is_file()), None)
    if (
        name in configuration.shipped()
        and local is not None
        and not local.samefile(configuration.shipped()[name])
    ):
        print(
            f"{name}: the shipped configuration is used, not ./{local}; give {local} for the file",
            file=sys.stderr,
        )
    return facets.load(name)


def report_coverage(about: Mapping[str, str]) -> None:
    """Print the coverage of expanded uncertainties.  about: see `describe_coverage`."""
    probability = 100 * float(about["coverage_probability"])
    text = (
        f"Expanded uncertainties: coverage probability {probability:g} %; degrees of freedom of "
        f"the calibration: {about['calibration_degrees_of_freedom']}."
    )
    report_lines(text)


def free_output(result: Path | None) -> AbstractContextManager[Any]:
    """Context in which messages go to standard error if the result is the standard output."""
    return redirect_stdout(sys.stderr) if result == STANDARD_STREAM else nullcontext()


def wrap(text: str) -> str:
    """Break a text into lines of 100 characters, indented after the first."""
    return fill(text, 100, subsequent_indent="  ")


def report_lines(text: str) -> None:
    """Print a note on a result, indented, in lines that fit a terminal."""
    print(fill(text, 98, initial_indent="  ", subsequent_indent="  "))


def draw_extra(path: Path, make: Callable[..., Any], *values: Any) -> None:
    """Write a picture or a page in addition to tables, which remain if this fails.

    make: returns the picture or the page's text, or writes the file itself and returns None.
    """
    try:
        drawing = make(*values)
        if isinstance(drawing, str):
            write_text(path, drawing)
        elif drawing is not None:
            pictures.style.save(drawing, path)
    except Exception as error:
        undrawn.append(path)
        remove_older(path)
        what = str(error).strip().partition("\n")[0]
        print(f"{path}: not drawn: {type(error).__name__}: {what}", file=sys.stderr)


def skip_picture(path: Path, why: str) -> None:
    """Report why no picture is drawn, and remove an older one."""
    remove_older(path)
    print(f"No picture was drawn: {why}.")


def show_table(
    title: str,
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    left_columns: Sequence[int] = (0,),
) -> None:
    """Print a table; on a terminal that is too narrow, a block of lines for each row.

    left_columns: indices of the left-aligned columns; the others hold numbers.
    """
    widths = [max(map(len, column)) for column in zip(headings, *rows, strict=True)]
    lines = [title] * bool(title)
    if sum(widths) + 2 * len(widths) <= shutil.get_terminal_size((10_000, 24)).columns:
        for row in (headings, *rows):
            cells = [
                cell.ljust(width) if n in left_columns else cell.rjust(width)
                for n, (cell, width) in enumerate(zip(row, widths, strict=True))
            ]
            lines.append(f" {'  '.join(cells)}".rstrip())
    else:
        for row in rows:
            lines += stack_row(headings, row)
    print("\n".join(lines) + "\n")


def stack_row(headings: Sequence[str], row: Sequence[str]) -> list[str]:
    """Print a row below its first cell; a heading without text belongs to the cell before it."""
    lines = [f" {row[0]}"]
    for heading, cell in zip(headings[1:], row[1:], strict=True):
        if heading and cell:
            lines.append(f"   {heading}: {cell}")
        elif cell:
            lines[-1] += f" {cell}"
    return lines


@contextmanager
def show_progress(task: str) -> Iterator[Callable[[float, float | None], None]]:
    """Show a bar for a task on a terminal; yields a callback `(completed, total)`.

    The callback ends the task if an interruption was swallowed.
    """
    if not sys.stderr.isatty():
        yield lambda *_: signals.check()
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        row = progress.add_task(task, total=None)

        def report(completed: float, total: float | None) -> None:
            signals.check()
            progress.update(row, completed=completed, total=total)

        yield report


def track(items: Iterable[Item], task: str, count: int) -> Iterator[Item]:
    """Yield items, with a bar on a terminal.  count: number of items."""
    with show_progress(task) as on_progress:
        for number, item in enumerate(items, 1):
            yield item
            on_progress(number, count)
