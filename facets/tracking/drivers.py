"""The contract of a stage's driver, and the drivers that exist.

Drivers of two serial lines are built in, Zaber and PI. Others come by entry points of the group
`facets.stages`: with `stage.driver: other`, the entry point `kinesis` drives the stages whose port
is named `kinesis:...`. It is called with that name and the block `stage` of the configuration, and
returns a `Driver`. Only the safety envelope opens drivers.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Protocol

from ..core.errors import FacetsError
from ..core.settings import Stage as Settings
from ..core.units import Floats
from .line import Line
from .pi import Pi
from .stage import StageError
from .zaber import Zaber

#: Group of the entry points by which other packages provide drivers.
GROUP = "facets.stages"
#: Drivers of this package on serial lines, by `stage.driver`.
DRIVERS: dict[str, type[Zaber | Pi]] = {"zaber": Zaber, "pi": Pi}
#: Drivers of this package that need an extra.
SHIPPED = (EntryPoint("kinesis", "facets.tracking.kinesis:open_kinesis", GROUP),)
PARTS = ("prepare", "place", "move", "stop", "emergency_stop", "close")
#: Further method of a driver that supports `stage.native_limits`: it writes the limits that the
#: controller had before.
RESTORE_LIMITS = "restore_limits"


class Driver(Protocol):
    """Two axes, x and y, that carry the beam, and the beam's places, mm: six methods.

    One thread calls `prepare`, `place`, `move` and `stop`; another may call `emergency_stop` at the
    same time, and any thread `close`. Every method except `close` raises `StageError` or any other
    exception for a fault, such as a stage that does not answer or refuses a command: then the
    envelope stops the stage. The envelope keeps soft limits, steps and freshness.
    """

    def prepare(self) -> None:
        """Stop the stage, and bound every move by `max_speed`, `acceleration` and `native_limits`
        of the settings. Raise `StageError` if the stage has no reference."""
        ...

    def place(self) -> Floats:
        """The beam's place by the encoders: (2,) mm."""
        ...

    def move(self, place: Floats) -> None:
        """Start both axes towards a place (2,), mm, and return before they arrive. Without another
        command the stage stops there by itself."""
        ...

    def stop(self, patience: float = 5.0) -> None:
        """Stop both axes, and return when the stage confirms it; raise `StageError` if the stage
        does not answer within `patience`, s."""
        ...

    def emergency_stop(self) -> None:
        """Command both axes to stop, from any thread, without waiting for an answer."""
        ...

    def close(self) -> None:
        """Close the line; a second call does nothing."""
        ...


def open_driver(port: Any, settings: Settings, clock: Callable[[], float]) -> Driver:
    """Open the driver of a stage.

    port: an open port like pyserial's; for `stage.driver: other` its name. Raises `StageError` if
    no driver has that name.
    """
    if settings.driver in DRIVERS:
        return DRIVERS[settings.driver](Line(port, clock), settings)
    return open_by_package(driver_of(str(port)), str(port), settings)


def driver_of(name: str) -> EntryPoint:
    """The entry point of `facets.stages` that drives the stage with a port of this name. Raises
    `StageError` if there is none."""
    scheme, colon, _ = name.partition(":")
    drivers: list[EntryPoint] = []
    if colon:
        drivers = [*entry_points(group=GROUP, name=scheme), *SHIPPED]
    for driver in drivers:
        if driver.name == scheme:
            return driver
    schemes = sorted({driver.name for driver in (*entry_points(group=GROUP), *SHIPPED)})
    raise StageError(
        f"{name}: there is no driver for a stage of that name; with stage.driver: other its port "
        f"begins with one of {', '.join(f'{driver}:' for driver in schemes)}"
    )


def open_by_package(driver: EntryPoint, name: str, settings: Settings) -> Driver:
    """Open the driver of another package. Errors other than those of facets, and an object without
    all methods, become a `StageError` that names the driver."""
    try:
        opened: Driver = driver.load()(name, settings)
    except FacetsError:
        raise
    except Exception as error:
        what = f"{driver.value}: {type(error).__name__}: {error}"
        raise StageError(f"{name}: cannot be opened by {what}") from None
    parts = (*PARTS, RESTORE_LIMITS) if settings.native_limits else PARTS
    lacks = [part for part in parts if not callable(getattr(opened, part, None))]
    if lacks:
        with suppress(Exception):
            opened.close()
        raise StageError(f"{name}: {driver.value} gives no driver: it has no {', '.join(lacks)}")
    return opened
