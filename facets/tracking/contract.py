"""Checks of the contract of a stage's driver, for the tests of any package.

    from facets.tracking.contract import check_driver

    def test_my_driver(my_simulator):
        check_driver(lambda: MyDriver(my_simulator), settings, my_simulator.wait, my_simulator.now)

The stage must be free to move: a simulator, or hardware with space around it.

Each check raises `AssertionError`, with what is wrong, if a driver fails it; places (2,) are in mm,
times in s.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np

from ..core.settings import Stage as Settings
from ..core.units import Floats
from .drivers import PARTS, Driver
from .limits import Limits

#: Length of the moves in the checks, mm.
MOVE_MM = 0.2
#: Two positions nearer than this are equal in the checks, mm.
SAME_PLACE_MM = 2e-3
#: Time between two readings of the position of a moving stage, s.
LOOK_INTERVAL_S = 5e-3
#: A move that takes longer than this has failed, s.
MAX_MOVE_S = 20.0


def check_driver(
    opened: Callable[[], Driver],
    settings: Settings,
    wait: Callable[[float], None] = time.sleep,
    now: Callable[[], float] = time.monotonic,
) -> None:
    """Raise `AssertionError` with a sentence if a driver breaks the contract of `drivers.Driver`.

    opened: opens a driver of a referenced stage at rest.  wait: lets a time, s, pass for the stage.
    now: the stage's clock, s.
    """
    driver = opened()
    try:
        check_parts(driver)
        driver.prepare()
        home = check_place(driver, Limits.from_settings(settings))
        check_move(driver, home + MOVE_MM, settings.max_speed, settings.step, wait, now)
        check_stop(driver, home - MOVE_MM, driver.stop, "stop", wait)
        check_stop(driver, home + 2 * MOVE_MM, driver.emergency_stop, "emergency_stop", wait)
        check_threads(driver)
        driver.move(home)
        driver.stop()
    finally:
        driver.close()
    driver.close()  # the second call must do nothing
    check_close(driver, home)


def check_parts(driver: Driver) -> None:
    """Check that the driver has all methods of the contract."""
    lacks = [part for part in PARTS if not callable(getattr(driver, part, None))]
    assert not lacks, f"the driver has no {', '.join(lacks)}"


def check_place(driver: Driver, limits: Limits) -> Floats:
    """Check that a place is two finite numbers, which are the same again while nothing moves;
    returns it."""
    first, second = driver.place(), driver.place()
    for place in (first, second):
        assert isinstance(place, np.ndarray), "place() gives no array"
        assert place.shape == (2,), f"place() has the shape {place.shape}, not (2,)"
        assert place.dtype == np.float64, f"place() gives {place.dtype}, not float64"
        assert np.isfinite(place).all(), f"place() gives {place}"
    assert np.abs(first - second).max() < SAME_PLACE_MM, "the stage moves though it was stopped"
    low, high = np.array(limits.low) + 3 * MOVE_MM, np.array(limits.high) - 3 * MOVE_MM
    inside = (low < first) & (first < high)
    assert inside.all(), "the stage is too near its limits"
    return first


def check_move(
    driver: Driver,
    goal: Floats,
    max_speed: float,
    step: float,
    wait: Callable[[float], None],
    now: Callable[[], float],
) -> None:
    """Check that the stage reaches its goal, no faster than allowed, and then stays there."""
    before, at = driver.place(), now()
    begin = at
    driver.move(goal)
    while np.abs(before - goal).max() > SAME_PLACE_MM:
        assert now() - begin < MAX_MOVE_S, f"the stage is at {before}, not at {goal}"
        place, then = driver.place(), now()
        most = 1.5 * max_speed * (then - at) + SAME_PLACE_MM + step
        assert np.abs(place - before).max() <= most, "the stage moves faster than max_speed"
        before, at = place, then
        wait(LOOK_INTERVAL_S)
    for _ in range(5):
        wait(LOOK_INTERVAL_S)
        assert np.abs(driver.place() - goal).max() < 2 * SAME_PLACE_MM, (
            "the stage goes past its goal"
        )


def check_stop(
    driver: Driver,
    goal: Floats,
    stop: Callable[[], None],
    name: str,
    wait: Callable[[float], None],
) -> None:
    """Check that a stopped move ends before its goal, and that the stage is then at rest."""
    driver.move(goal)
    stop()
    for _ in range(100):  # the stage may need a while to come to rest
        before = driver.place()
        wait(0.02)
        if np.abs(driver.place() - before).max() < SAME_PLACE_MM / 10:
            break
    else:
        raise AssertionError(f"the stage still moves after {name}()")
    assert np.abs(driver.place() - goal).max() > SAME_PLACE_MM, f"{name}() did not stop the move"


def check_threads(driver: Driver) -> None:
    """Check that an `emergency_stop` from another thread damages no answer."""
    failed: list[BaseException] = []

    def emergency_stop() -> None:
        try:
            for _ in range(20):
                driver.emergency_stop()
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=emergency_stop)
    thread.start()
    try:
        for _ in range(20):
            assert np.isfinite(driver.place()).all(), "an emergency stop spoils an answer"
    finally:
        thread.join()
    assert not failed, f"emergency_stop() raised {failed[0]!r}"


def check_close(driver: Driver, goal: Floats) -> None:
    """Check that a closed driver moves nothing, and raises an error."""
    try:
        driver.move(goal)
    except Exception:
        return
    raise AssertionError("a driver that is closed takes moves without a word")
