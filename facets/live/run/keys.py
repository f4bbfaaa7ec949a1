"""Keys that a person presses in the terminal of a run."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

#: Interval at which keys are polled, s.
POLL_S = 0.2


@contextmanager
def watch_keys(actions: Mapping[str, Callable[[], None]]) -> Iterator[None]:
    """Call the action of each pressed key within the block, from a separate thread.

    Nothing is read if the standard input is no terminal, or while the program runs in the
    background, because the terminal then belongs to another program.
    """
    if not sys.stdin or not sys.stdin.isatty():
        yield
        return
    ending = threading.Event()
    terminal = None if os.name == "nt" else Terminal()
    read = terminal.read if terminal else read_windows
    thread = threading.Thread(target=listen, args=(read, actions, ending), daemon=True)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join(timeout=5 * POLL_S)
        if terminal:
            terminal.restore()


def listen(
    read: Callable[[], str], actions: Mapping[str, Callable[[], None]], ending: threading.Event
) -> None:
    """Call the action of each key that is read, until the run ends."""
    while not ending.is_set():
        for key in read():
            if key in actions:
                actions[key]()


class Terminal:
    """The terminal of a POSIX system, which gives each key at once and does not show it."""

    def __init__(self) -> None:
        import termios

        self.place = sys.stdin.fileno()
        self.before: list[Any] = termios.tcgetattr(self.place)

    def read(self) -> str:
        """Return the pressed keys; wait for up to POLL_S if there are none."""
        import select
        import termios
        import time
        import tty

        try:
            if os.tcgetpgrp(self.place) != os.getpgrp():
                time.sleep(POLL_S)
                return ""
            if termios.tcgetattr(self.place)[3] & termios.ICANON:  # also after ^Z and fg
                tty.setcbreak(self.place, termios.TCSANOW)
            if not select.select([self.place], [], [], POLL_S)[0]:
                return ""
            data = os.read(self.place, 100)
        except (OSError, termios.error):  # the terminal is gone
            data = b""
        if not data:
            time.sleep(POLL_S)
        return data.decode("ascii", "ignore")

    def restore(self) -> None:
        """Restore the terminal's settings; errors are ignored."""
        import termios

        with suppress(OSError, termios.error):
            if os.tcgetpgrp(self.place) == os.getpgrp():
                termios.tcsetattr(self.place, termios.TCSANOW, self.before)


def read_windows() -> str:
    """Return the keys that were pressed on Windows; wait for up to POLL_S if there are none."""
    import msvcrt
    import time

    keys = ""
    while msvcrt.kbhit():  # type: ignore[attr-defined]
        keys += msvcrt.getwch()  # type: ignore[attr-defined]
    if not keys:
        time.sleep(POLL_S)
    return keys
