"""What a stage's driver must do, and where drivers come from.

Two are built in for serial lines, Zaber and PI. Others come by entry points of the group
`facets.stages`: with `stage.driver: other`, one named `kinesis` drives the stages whose port is
named `kinesis:...`. It is called with that name and the block `stage` of the configuration, and
returns a `Driver`. Nobody but the safety envelope opens one.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Protocol

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .line import Line
from .pi import Pi
from .stage import StageError
from .zaber import Zaber

#: Of the entry points by which other packages bring drivers.
GROUP = "facets.stages"
#: What is shipped, and needs an extra.
SHIPPED = (EntryPoint("kinesis", "facets.tracking.kinesis:open_kinesis", GROUP),)
PARTS = ("prepare", "place", "move", "stop", "cry", "close")


class Driver(Protocol):
    """Two axes, x and y, and the places of the beam that they carry, mm: six methods.

    One thread calls `prepare`, `place`, `move` and `stop`, another may call `cry` meanwhile, and
    both may meet `close`. What goes wrong is raised, as `StageError` or any other exception: then
    the envelope stops the stage. Soft limits, steps and freshness are the envelope's.
    """

    def prepare(self) -> None:
        """Stops what goes on, and sees that no move can be faster than `max_speed` and
        `acceleration` of the settings. Raises where the stage has no reference."""
        ...

    def place(self) -> Floats:
        """Where the encoders say that the beam is: (2,) mm."""
        ...

    def move(self, place: Floats) -> None:
        """Starts both axes towards a place (2,), mm, and does not wait until they are there. A
        stage that is told nothing more stops there by itself."""
        ...

    def stop(self, patience: float = 5.0) -> None:
        """Stops both axes, and returns when the stage says that it does; raises where it does not
        answer for so many seconds."""
        ...

    def cry(self) -> None:
        """Tells both axes to stop without waiting for an answer; from any thread."""
        ...

    def close(self) -> None:
        """Lets go of the line; again does nothing."""
        ...


def open_driver(port: Any, settings: Settings, clock: Callable[[], float]) -> Driver:
    """The driver of a stage.

    port: open, as pyserial's; for `stage.driver: other` its name. Raises `StageError` where nobody
    drives a stage of that name.
    """
    if settings.driver == "zaber":
        return Zaber(Line(port, clock), settings)
    if settings.driver == "pi":
        return Pi(Line(port, clock), settings)
    return open_by_package(driver_of(str(port)), str(port), settings)


def driver_of(name: str) -> EntryPoint:
    """The entry point of `facets.stages` for a port of that name."""
    scheme, colon, _ = name.partition(":")
    found: list[EntryPoint] = []
    if colon:
        found = [*entry_points(group=GROUP, name=scheme), *SHIPPED]
    for one in found:
        if one.name == scheme:
            return one
    known = sorted({one.name for one in (*entry_points(group=GROUP), *SHIPPED)})
    raise StageError(
        f"{name}: there is no driver for a stage of that name; with stage.driver: other its port "
        f"begins with one of {', '.join(f'{one}:' for one in known)}"
    )


def open_by_package(driver: EntryPoint, name: str, settings: Settings) -> Driver:
    """The driver that another package opens; what it raises besides `StageError` names it."""
    try:
        found: Driver = driver.load()(name, settings)
    except StageError:
        raise
    except Exception as error:
        what = f"{driver.value}: {type(error).__name__}: {error}"
        raise StageError(f"{name}: cannot be opened by {what}") from None
    lacks = [part for part in PARTS if not callable(getattr(found, part, None))]
    if lacks:
        raise StageError(f"{name}: {driver.value} gives no driver: it has no {', '.join(lacks)}")
    return found
