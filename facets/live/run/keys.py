"""Keys that a person presses in the terminal of a run."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

#: A key is looked for so often, s.
POLL_S = 0.2


@contextmanager
def watch_keys(actions: Mapping[str, Callable[[], None]]) -> Iterator[None]:
    """Within it a key that is pressed calls its action, from a thread of its own.

    Where the standard input is no terminal nothing happens, and nothing is read. A program in the
    background reads nothing either, since the terminal then belongs to another.
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
        """Keys that were pressed; waits for some no longer than POLL_S."""
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
