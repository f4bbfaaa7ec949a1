"""The settings of a configuration: frozen, in the units of the code (mm, rad, mW, s)."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any, Literal

from .axis_keys import MAX_LENGTH_MM
from .calibrate import Calibrate
from .keys import Key, block_of, block_of_keys, item_of, key
from .knowledge import BeamKnowledge, Knowledge, PowerKnowledge, Prior
from .layout import Layout
from .motions import Motion
from .rules import Rules
from .sensor import Electronics, Sensor
from .units import Floats

MAX_BAUD = 100_000_000
PLACE_MM: dict[str, Any] = {"ge": -MAX_LENGTH_MM, "le": MAX_LENGTH_MM}
Pair = tuple[float, float]


def check_line(value: str) -> str:
    """The name of a line into or out of this machine; raises `ValueError` for any other text."""
    kind, colon, place = value.partition(":")
    if value != "board" and not (kind in ("ni", "file") and colon and place):
        raise ValueError(f"must be board, ni:DEVICE/LINE or file:PATH (got {value!r})")
    return value


@dataclass(frozen=True)
class Acquire:
    """The detector board's stream; how counts become light is in `sensor.electronics`."""

    port: str | None = key(
        "port",
        None,
        "device or URL: /dev/ttyACM0, COM3, socket://host:port, udp://:port, file:bytes.bin",
    )
    baud: int = key("baud", 3_000_000, "baud rate of a serial line", gt=0, le=MAX_BAUD)
    format: Literal["frames", "cobs", "text"] = key(
        "format", "frames", "format of the stream; see Formats in the documentation"
    )
    content: Literal["electrodes", "xy-sum"] = key(
        "content", "electrodes", "numbers in a text line; frames state theirs"
    )
    dark: float = key("dark_counts", 0.0, "reading of an electrode without light", ge=-1e9, le=1e9)
    timing: Literal["envelope", "arrival"] = key(
        "timing",
        "envelope",
        "how samples get the host's time: by the soonest arrivals of a minute, which "
        "know the board's clock best, or each block by its own arrival, as versions before did",
    )
    least_delay: float = key(
        "least_delay_ms",
        0.2,
        "shortest delay from a sample to its bytes at the host; for `envelope`",
        ge=0,
        le=1000,
    )
    delay: float = key(
        "delay_ms",
        1.5,
        "mean delay from a sample to its bytes at the host; for `arrival`",
        ge=0,
        le=1000,
    )
    mark: Literal["trigger", "pps"] = key(
        "mark",
        "trigger",
        "what the board's marked input is: of no meaning here, or a pulse per second "
        "at whole seconds of UTC, which then steers `utc_s` of what is published and replayed",
    )
    wait: float = key(
        "wait_seconds",
        5.0,
        "longest wait for a port that does not exist yet, such as that of a booting board",
        ge=0,
        le=3600,
    )
    sync: float = key(
        "sync_seconds",
        1.0,
        "a power failure costs a recording no more than its last so many seconds; "
        "0: the system writes back when it likes",
        ge=0,
        le=3600,
    )
    detectors: int = key(
        "detectors",
        3,
        "2: the same as `solve.accept_unchecked: true`, as older files have it",
        ge=2,
        le=3,
    )


@dataclass(frozen=True)
class Stage:
    """The two-axis stage that carries the beam."""

    driver: Literal["zaber", "pi", "other"] = key(
        "driver",
        "zaber",
        "Zaber ASCII, PI GCS 2.0, or what the port's name begins with, as kinesis:",
    )
    port: str | None = key(
        "port", None, "device or URL; for `other` a name as kinesis:27000001,27000002"
    )
    baud: int = key("baud", 115_200, "baud rate of a serial line", gt=0, le=MAX_BAUD)
    step: float = key("step_um", 0.1, "Zaber: one native unit of position", gt=0, le=1000)
    zero: Pair = key("zero_mm", (0.0, 0.0), "position of the beam at the stage's zero", **PLACE_MM)
    low: Pair = key(
        "low_mm",
        (-7.0, -7.0),
        "soft limits in the stage's own coordinates, as its controller shows them, "
        "whatever `zero_mm` is",
        **PLACE_MM,
    )
    high: Pair = key("high_mm", (7.0, 7.0), "upper soft limits, as `low_mm`", **PLACE_MM)
    max_speed: float = key(
        "max_speed_mm_s", 20.0, "largest speed of commanded moves", gt=0, le=10_000
    )
    max_step: float = key(
        "max_step_mm", 0.5, "largest length of one commanded move", gt=0, le=MAX_LENGTH_MM
    )
    rate: float = key("rate_hz", 100.0, "rate of commands", gt=0, le=10_000)
    accuracy: float = key(
        "accuracy_um", 2.0, "standard uncertainty of the stage's encoder", gt=0, le=10_000
    )
    law: Literal["proportional", "pi", "feedforward"] = key(
        "law",
        "feedforward",
        "Eq. (14), the same with an integral, or by the solved place of the apex",
    )
    gain: float = key("gain", 0.5, "share of the error that one command takes away", gt=0, le=2)
    integral: float = key("integral", 0.1, "for `pi`: share of the summed error", ge=0, le=1)
    stale: float = key(
        "stale_ms",
        50.0,
        "age from which on a pose is not followed; a predicted motion may follow it",
        gt=0,
        le=10_000,
    )
    bridge: float = key(
        "bridge_ms",
        150.0,
        "after the last good pose the stage may follow the predicted motion for this "
        "long, at most; then it stops. 0 turns prediction off. The circle of the virtual bench "
        "(9.9 mm/s²) leaves its predicted line by 0.11 mm in 150 ms, a third of the range in which "
        "there are poses",
        ge=0,
        le=1000,
    )
    bridge_distance: float = key(
        "bridge_mm",
        1.0,
        "largest distance of a predicted place from the last good pose: 150 ms at "
        "6.7 mm/s; a faster mirror is predicted for a shorter time",
        ge=0,
        le=MAX_LENGTH_MM,
    )
    lag: float = key(
        "lag_ms", 8.0, "time constant of the stage's answer to a step", ge=0, le=10_000
    )
    latency: float = key(
        "latency_ms",
        5.0,
        "time from light on the detectors to the start of the stage's move",
        ge=0,
        le=10_000,
    )
    acceleration: float = key(
        "acceleration_mm_s2", 2000.0, "largest acceleration of the stage", gt=0, le=1e7
    )
    resume: Literal["person", "auto"] = key(
        "resume",
        "person",
        "who ends a stop: a person, or, after a stop for want of good samples, the "
        "program itself as soon as there are good ones; stops for any other reason need a person",
    )
    resumes_per_hour: int = key(
        "resumes_per_hour", 6, "largest number of stops in an hour that `auto` ends", ge=1, le=3600
    )
    permit: str | None = key(
        "permit",
        None,
        "input without which no move is sent: `board` (the flag 8 of its frames), "
        "`ni:Dev1/port0/line0`, or `file:PATH` of a file that holds 1",
        check=check_line,
    )
    heartbeat: str | None = key(
        "heartbeat",
        None,
        "where the program sends a sign of life while the stage may move: `board` (its "
        "port), `ni:Dev1/port0/line1` (toggles), or `file:PATH`",
        check=check_line,
    )
    checked: str | None = key(
        "checked",
        None,
        "date of the check of the wiring, and the driver, port and step of the stage "
        "that was checked, as `acquire --check-stage` writes them",
        max_length=300,
    )


@dataclass(frozen=True)
class Solve:
    """How readings are solved for the pose."""

    beam: Literal["free", "known", "prior"] = key(
        "beam",
        "free",
        "position of the beam: free (solved for), known (at the origin, or where the readings' "
        "table says), or prior (known within `beam_sigma_um`)",
    )
    beam_sigma: float = key(
        "beam_sigma_um",
        5.0,
        "standard uncertainty of the beam's position, for `beam: prior`",
        gt=0,
        le=10_000,
    )
    power: Literal["known", "prior", "unknown"] = key(
        "power",
        "prior",
        "power of the beam: known (as in `sensor.beam`), prior (known within "
        "`power_sigma_percent`), or unknown (solved for); method: paper takes it as known",
    )
    power_sigma: float = key(
        "power_sigma_percent",
        1.0,
        "standard uncertainty of the beam's power, for `power: prior`",
        gt=0,
        le=100,
    )
    method: Literal["least-squares", "paper"] = key(
        "method", "least-squares", "all nine readings, or Newton on eight as in the paper"
    )
    start: Literal["zero", "previous"] = key(
        "start", "zero", "where each solution starts: from zero or from the sample before"
    )
    max_steps: int = key(
        "max_steps",
        50,
        "largest number of steps, after which a sample counts as not solved",
        ge=1,
        le=10_000,
    )
    accept_unchecked: bool = key(
        "accept_unchecked",
        False,
        "whether to give poses that no number is left to check, as those of two detectors",
    )

    def knowledge(self, sensor: Sensor, position: Floats | None = None) -> Knowledge:
        """What these settings say of the beam, as `facets.solve` takes it.

        A beam or a power that is known is known as well as the laser keeps it
        (`Electronics.pointing`, `power_noise`).
        position: (n, 2) or (1, 2) of the beam, mm; by default the origin.
        """
        return Knowledge(beam=self._beam(sensor, position), power=self._power(sensor))

    def _beam(self, sensor: Sensor, position: Floats | None) -> BeamKnowledge:
        if self.beam == "free":
            return "free"
        sigma = self.beam_sigma if self.beam == "prior" else 0.0
        sigma = hypot(sigma, sensor.electronics.pointing if sensor.electronics else 0.0)
        if position is None:
            return Prior((0.0, 0.0), sigma)
        return Prior(position[0] if len(position) == 1 else position, sigma)

    def _power(self, sensor: Sensor) -> PowerKnowledge:
        if self.method == "paper":
            return "known"
        if self.power == "unknown":
            return "unknown"
        sigma = self.power_sigma if self.power == "prior" else 0.0
        sigma = hypot(sigma, sensor.electronics.power_noise if sensor.electronics else 0.0)
        return Prior(sensor.beam.power, sigma * sensor.beam.power) if sigma > 0 else "known"


SIMULATE = Key(
    "simulate",
    {},
    "settings of `facets simulate`",
    block=block_of_keys(
        "Simulate",
        "What `facets simulate` adds to the motions.",
        [
            Key("noise", True, "whether readings carry noise", hint=bool),
            Key(
                "seed",
                1,
                "seed of the random numbers; the same seed gives the same run",
                hint=int,
                bounds={"ge": 0, "le": 2**32 - 1},
            ),
        ],
        dict,
    ),
)


@dataclass(frozen=True)
class Config:
    """A checked configuration.

    name: file name without suffix.  path: of the file.
    electronics: of the detectors, also where the noise does not follow from them.
    resolved: the same as plain types with every default filled in, in the units of the YAML keys.
    sha256: of `resolved` as JSON; equal sums mean equal sensors, motions and settings.
    """

    name: str
    path: Path
    sensor: Sensor
    motions: dict[str, Motion]
    electronics: Electronics
    resolved: dict[str, Any]
    sha256: str
    noise: bool = item_of(SIMULATE, "noise")
    seed: int = item_of(SIMULATE, "seed")
    solve: Solve = key("solve", {}, "settings of the solver", block=block_of(Solve))
    acquire: Acquire = key("acquire", {}, "the detector board's stream", block=block_of(Acquire))
    stage: Stage = key("stage", {}, "the stage that carries the beam", block=block_of(Stage))
    range: Rules = key("range", {}, "what counts as the measurement range", block=block_of(Rules))
    calibrate: Calibrate = key(
        "calibrate", {}, "what `facets calibrate` takes and finds", block=block_of(Calibrate)
    )
    layout: Layout = key("optimize", {}, "what `facets optimize` looks for", block=block_of(Layout))
