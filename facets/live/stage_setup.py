"""Open a stage for a run, refuse an unsafe one, and report the check of its wiring."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..characterization.ranges import axis_ranges
from ..core.errors import InputError
from ..files import provenance, whole
from ..tracking.check import StageCheck, stage_identity
from ..tracking.control import capture_range, margin_of
from ..tracking.envelope import Envelope
from .sources.ports import VIRTUAL, open_line

if TYPE_CHECKING:
    from ..core.settings import Config, Stage
    from .virtual.in_process import BenchInProcess


def refuse_board(config: Config, port: str) -> None:
    """Raise `InputError` for a permit or a heartbeat that the board does not support."""
    lines = {config.stage.permit, config.stage.heartbeat}
    if port.startswith(VIRTUAL) and not lines <= {None, "board"}:
        raise InputError(
            f"stage.permit and stage.heartbeat must be board or left out for {port}, because "
            "nothing real may depend on a virtual bench"
        )
    if config.stage.permit == "board" and config.acquire.format == "text":
        raise InputError(
            "stage.permit is board: lines of text have no flag for it; use acquire.format: frames"
        )
    if config.stage.heartbeat == "board" and port.startswith(("file:", "ni:", "thorlabs:")):
        raise InputError(f"stage.heartbeat is board, but nothing can be sent to {port}")


def require_stage_check(config: Config, port: str) -> None:
    """Raise `InputError` for a stage whose wiring has not been checked."""
    checked, identity = (
        config.stage.checked,
        stage_identity(config.stage.driver, port, config.stage.step),
    )
    if checked and checked.partition(" ")[2] == identity:
        return
    what = (
        f"is {checked!r}, which is not the stage that is configured now, {identity!r}"
        if checked
        else "is not given"
    )
    raise InputError(
        f"stage.checked {what}: run `facets acquire CONFIG --check-stage --write FILE.yaml` once "
        "with the mirror at rest, and then track with FILE.yaml"
    )


def require_stability(config: Config, on_progress: Callable[[str], None]) -> None:
    """Report the stability of the loop; raise `InputError` if it would be unstable."""
    stage = config.stage
    axes = axis_ranges(config.sensor, config.range, np.zeros(6))[:2]
    clearance = min(axis.symmetric / 2 for axis in axes)
    margin = margin_of(stage, capture_range(config.sensor, clearance))
    on_progress(f"stage: {stage.law}, {margin.words}")
    if margin.times < 1:
        raise InputError(
            f"stage.gain is {stage.gain}: with a delay of {1e3 * margin.delay:.3g} ms at "
            f"{stage.rate:g} Hz the loop is unstable; allowed: below {margin.most:.3g}"
        )


def open_envelope(
    settings: Stage,
    port: str,
    bench: BenchInProcess | None,
    is_reopened: bool,
    add_event: Callable[..., None],
) -> Envelope:
    """Open the stage, or that of a virtual bench with the clock of the bench.

    is_reopened: whether the stage's line is opened again after a fault. Raises `PortError` or
    `StageError` if the stage cannot be used.
    """

    def open_port() -> Any:
        """Open the bench's stage or the serial line; another driver gets the port's name."""
        if bench is not None:
            return bench.open_stage()
        return port if settings.driver == "other" else open_line(port, settings.baud, 0.02)

    # no stage but the virtual one has another clock than the host's
    clock = bench.clock if bench else time.monotonic
    open_again = open_port if is_reopened else None
    return Envelope(open_port(), settings, add_event, clock, open_again)


def check_sentences(
    check: StageCheck, config: Config, port: str, path: Path | None, is_good: bool
) -> Iterator[str]:
    """Yield the results of a stage's check; write the checked configuration to `path`, if any.

    Nothing is written if the check, or the run that it was part of, is not good.
    """
    if check.is_complete:
        for axis in check.axes():
            yield axis.sentence
    if not is_good:
        return
    stage = config.stage
    delay_ms = 1e3 * (stage.latency + stage.lag)
    yield (
        f"The stage is wired as the configuration says. It expects a delay of {delay_ms:.3g} ms "
        "(stage.latency_ms and stage.lag_ms)."
    )
    value = f"{datetime.now(UTC):%Y-%m-%d} {stage_identity(stage.driver, port, stage.step)}"
    if path is None:
        yield f"For --track, add to the configuration: stage: {{checked: {value}}}"
        return
    block = {**config.resolved["stage"], "checked": value}
    about = provenance.provenance_header(config)
    whole.write_text(path, provenance.configuration(config, block, about, "stage"))
    yield f"{path}"
