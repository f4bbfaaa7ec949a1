"""The display of a run by `facets acquire`: a screen, or lines of text or JSON."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from facets import live

if TYPE_CHECKING:
    from facets.live.assembly import Show


def tell(text: str) -> None:
    """Print to the standard error, which may be closed with its terminal."""
    with suppress(OSError):
        print(text, file=sys.stderr)


@contextmanager
def display(state: live.Live, plain: bool, json: bool) -> Iterator[Show]:
    """Show the run in the terminal, or by lines of text or JSON.

    Yields a function that must be called often and prints a line now and then.
    """
    if not (json or plain) and sys.stdout.isatty():
        from rich.live import Live as TerminalView

        screen = TerminalView(get_renderable=lambda: live.Screen(state), refresh_per_second=8)
        screen.start()
        try:
            yield lambda _: None
        finally:
            with suppress(OSError):  # the terminal may be gone
                screen.stop()
        return
    interval_s, last, shown = 0.125 if json else 1.0, state.clock(), 0

    def print_line(now: live.Live) -> None:
        """Print a line at each interval, and at once when a message appears or ends."""
        nonlocal last, shown
        count = len(now.messages())
        if count != shown or state.clock() - last >= interval_s:
            last, shown = state.clock(), count
            print(live.json_line(now) if json else live.plain_line(now))

    yield print_line


def report(run: live.Run) -> None:
    """Print the outcome of the run, even if the output is closed."""
    with suppress(OSError):
        for text in live.summary(run.live):
            print(text)
        if run.recording:
            print(f"{run.recording.folder}/")
