"""The keys of a bench: where counts come from, and the stage that carries the beam."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from .section import MAX_LENGTH, Section


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


Place = Annotated[float, Field(ge=-MAX_LENGTH, le=MAX_LENGTH)]
Pair = Annotated[
    tuple[Place, Place], BeforeValidator(_tuple, json_schema_input_type=tuple[Place, Place])
]


def _line(value: str) -> str:
    kind, colon, place = value.partition(":")
    if value != "board" and not (kind in ("ni", "file") and colon and place):
        raise ValueError(f"must be board, ni:DEVICE/LINE or file:PATH (got {value!r})")
    return value


#: A line into or out of this machine, by which a stage is permitted to move or watched.
Line = Annotated[str, AfterValidator(_line)]


class Acquire(Section):
    """The detector board's stream; how counts become light is in `sensor.electronics`."""

    port: str | None = Field(
        None,
        description="device or URL: /dev/ttyACM0, COM3, socket://host:port, udp://:port, "
        "file:bytes.bin",
    )
    baud: int = Field(3_000_000, gt=0, le=100_000_000, description="of a serial line")
    format: Literal["frames", "cobs", "text"] = Field(
        "frames", description="of the stream; see Formats in the documentation"
    )
    content: Literal["electrodes", "xy-sum"] = Field(
        "electrodes", description="of text lines; frames say it themselves"
    )
    dark_counts: float = Field(
        0.0, ge=-1e9, le=1e9, description="what an electrode reads without light"
    )
    timing: Literal["envelope", "arrival"] = Field(
        "envelope",
        description="how samples get the host's time: by the soonest arrivals of a minute, which "
        "know the board's clock best, or each block by its own arrival, as versions before did",
    )
    least_delay_ms: float = Field(
        0.2,
        ge=0,
        le=1000,
        description="from a sample to its bytes at the host, at the soonest; for `envelope`",
    )
    delay_ms: float = Field(
        1.5,
        ge=0,
        le=1000,
        description="from a sample to its bytes at the host, on average; for `arrival`",
    )
    mark: Literal["trigger", "pps"] = Field(
        "trigger",
        description="what the board's marked input is: of no meaning here, or a pulse per second "
        "at whole seconds of UTC, which then steers `utc_s` of what is published and replayed",
    )
    wait_seconds: float = Field(
        5.0, ge=0, le=3600, description="for a port that is not there yet, since a board boots"
    )
    sync_seconds: float = Field(
        1.0, ge=0, le=3600,
        description="a power failure costs a recording no more than its last so many seconds; "
        "0: the system writes back when it likes",
    )  # fmt: skip
    detectors: int = Field(
        3,
        ge=2,
        le=3,
        description="2: the same as `solve.accept_unchecked: true`, as older files have it",
    )


class Stage(Section):
    """The two-axis stage that carries the beam."""

    driver: Literal["zaber", "pi", "other"] = Field(
        "zaber",
        description="Zaber ASCII, PI GCS 2.0, or what the port's name begins with, as kinesis:",
    )
    port: str | None = Field(
        None, description="device or URL; for `other` a name as kinesis:27000001,27000002"
    )
    baud: int = Field(115_200, gt=0, le=100_000_000, description="of a serial line")
    step_um: float = Field(0.1, gt=0, le=1000, description="Zaber: one native unit of position")
    zero_mm: Pair = Field((0.0, 0.0), description="beam's place at the stage's zero")
    low_mm: Pair = Field(
        (-7.0, -7.0),
        description="soft limits in the stage's own coordinates, as its controller shows them, "
        "whatever `zero_mm` is",
    )
    high_mm: Pair = Field((7.0, 7.0), description="upper soft limits, as `low_mm`")
    max_speed_mm_s: float = Field(20.0, gt=0, le=10_000, description="of commanded moves")
    max_step_mm: float = Field(0.5, gt=0, le=MAX_LENGTH, description="of one commanded move")
    rate_hz: float = Field(100.0, gt=0, le=10_000, description="of commands")
    accuracy_um: float = Field(2.0, gt=0, le=10_000, description="of its encoder, 1 sigma")
    law: Literal["proportional", "pi", "feedforward"] = Field(
        "feedforward",
        description="Eq. (14), the same with an integral, or by the solved place of the apex",
    )
    gain: float = Field(
        0.5, gt=0, le=2, description="share of the error that one command takes away"
    )
    integral: float = Field(0.1, ge=0, le=1, description="for `pi`: share of the summed error")
    stale_ms: float = Field(
        50.0,
        gt=0,
        le=10_000,
        description="age from which on a pose is not followed; a predicted motion may follow it",
    )
    bridge_ms: float = Field(
        150.0,
        ge=0,
        le=1000,
        description="after the last good pose the stage may follow the predicted motion for this "
        "long, at most; then it stops. 0 turns prediction off. The circle of the virtual bench "
        "(9.9 mm/s²) leaves its predicted line by 0.11 mm in 150 ms, a third of the range in which "
        "there are poses",
    )
    bridge_mm: float = Field(
        1.0,
        ge=0,
        le=MAX_LENGTH,
        description="largest distance of a predicted place from the last good pose: 150 ms at "
        "6.7 mm/s; a faster mirror is predicted for a shorter time",
    )
    lag_ms: float = Field(8.0, ge=0, le=10_000, description="its answer to a step: time constant")
    latency_ms: float = Field(
        5.0, ge=0, le=10_000, description="from light on the detectors to the stage's start"
    )
    acceleration_mm_s2: float = Field(2000.0, gt=0, le=1e7, description="largest")
    resume: Literal["person", "auto"] = Field(
        "person",
        description="who ends a stop: a person, or, after a stop for want of good samples, the "
        "program itself as soon as there are good ones; stops for any other reason need a person",
    )
    resumes_per_hour: int = Field(
        6, ge=1, le=3600, description="largest number of stops in an hour that `auto` ends"
    )
    permit: Line | None = Field(
        None,
        description="input without which no move is sent: `board` (the flag 8 of its frames), "
        "`ni:Dev1/port0/line0`, or `file:PATH` of a file that holds 1",
    )
    heartbeat: Line | None = Field(
        None,
        description="where the program sends a sign of life while the stage may move: `board` (its "
        "port), `ni:Dev1/port0/line1` (toggles), or `file:PATH`",
    )
    checked: str | None = Field(
        None,
        max_length=300,
        description="date of the check of the wiring, and the driver, port and step of the stage "
        "that was checked, as `acquire --check-stage` writes them",
    )
