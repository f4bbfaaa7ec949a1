"""The settings of a configuration: frozen, in the units of the code (mm, rad, mW, s)."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from math import hypot
from pathlib import Path
from typing import Any, Literal

from .axis_keys import MAX_LENGTH_MM
from .calibrate import Calibrate
from .channels import AuxiliaryChannel
from .keys import Key, block_of, block_of_keys, item_of, key
from .knowledge import BeamKnowledge, Knowledge, PowerKnowledge, Prior, Question
from .layout import Layout
from .motions import Motion
from .notebook import show_shortly
from .plain_numbers import count_text
from .rigid_body import MIRROR, MeasuredObject
from .rules import Rules
from .sensor import Electronics, Sensor
from .units import Floats

MAX_BAUD = 100_000_000
PLACE_MM: dict[str, Any] = {"ge": -MAX_LENGTH_MM, "le": MAX_LENGTH_MM}
Pair = tuple[float, float]


def drop_mirror(body: MeasuredObject) -> MeasuredObject | None:
    """Return None for an object that is the mirror itself."""
    return None if body == MIRROR else body


#: Name of an input or output line.
LINE = {
    "pattern": "^(board|(ni|file):.+)$",
    "error": "must be board, ni:DEVICE/LINE or file:PATH",
}


@dataclass(frozen=True)
class Acquire:
    """The detector board's stream; `sensor.electronics` determines how counts become light."""

    port: str | None = key(
        "port",
        None,
        "device or URL: /dev/ttyACM0, COM3, socket://host:port, udp://host:port, file:bytes.bin or "
        "a simulated bench, virtual:motion",
    )
    baud: int = key("baud", 3_000_000, "baud rate of a serial line", gt=0, le=MAX_BAUD)
    format: Literal["frames", "cobs", "text"] = key(
        "format", "frames", "format of the stream; see Formats in the documentation"
    )
    content: Literal["electrodes", "xy-sum"] = key(
        "content", "electrodes", "numbers in a line of text; binary frames state theirs"
    )
    channels: tuple[AuxiliaryChannel, ...] = key(
        "channels",
        [],
        "auxiliary channels of each sample, such as a force, in the order of the frame; see "
        "Formats in the documentation",
        listed=block_of(AuxiliaryChannel),
        max_length=15,
    )
    dark: float = key("dark_counts", 0.0, "reading of an electrode without light", ge=-1e9, le=1e9)
    timing: Literal["envelope", "arrival"] = key(
        "timing",
        "envelope",
        "method that gives samples the host's time: `envelope` fits the board's clock to the "
        "soonest arrivals of a minute; `arrival` gives each block its own arrival time",
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
        "without effect, kept for older files: the column `flags` marks the samples after an edge",
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
        "longest time between two writes to the disk, which a power failure can cost; 0: the "
        "operating system decides",
        ge=0,
        le=3600,
    )
    detectors: int = key(
        "detectors",
        3,
        "2: the same as `solve.accept_unchecked: true`, kept for older files",
        ge=2,
        le=3,
    )


@dataclass(frozen=True)
class Stage:
    """The two-axis stage that carries the beam."""

    driver: Literal["zaber", "pi", "other"] = key(
        "driver",
        "zaber",
        "Zaber ASCII, PI GCS 2.0, or another driver by the first part of the port's name, such as "
        "kinesis:",
    )
    port: str | None = key(
        "port", None, "device or URL; for `other` a name such as kinesis:27000001,27000002"
    )
    baud: int = key("baud", 115_200, "baud rate of a serial line", gt=0, le=MAX_BAUD)
    step: float = key("step_um", 0.1, "Zaber: one native unit of position", gt=0, le=1000)
    zero: Pair = key("zero_mm", (0.0, 0.0), "position of the beam at the stage's zero", **PLACE_MM)
    low: Pair = key(
        "low_mm",
        (-7.0, -7.0),
        "soft limits in the stage's own coordinates, as its controller shows them; `zero_mm` does "
        "not shift them",
        **PLACE_MM,
    )
    high: Pair = key("high_mm", (7.0, 7.0), "upper soft limits, like `low_mm`", **PLACE_MM)
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
        "control law: Eq. (14), Eq. (14) with an integral term, or the solved position of the apex",
    )
    gain: float = key("gain", 0.5, "fraction of the error that one command corrects", gt=0, le=2)
    integral: float = key(
        "integral", 0.1, "for `pi`: fraction of the summed error that it corrects", ge=0, le=1
    )
    stale: float = key(
        "stale_ms",
        50.0,
        "age beyond which a pose is not followed, by the soonest data of the run; a predicted "
        "motion may follow it",
        gt=0,
        le=10_000,
    )
    bridge: float = key(
        "bridge_ms",
        150.0,
        "longest time after the last good pose for which the stage may follow the predicted "
        "motion before it stops; 0 turns prediction off. The circle of the virtual bench (9.9 "
        "mm/s²) leaves its predicted line by 0.11 mm in 150 ms, a third of the range in which "
        "poses are solved",
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
    native_limits: Pair | None = key(
        "native_limits",
        None,
        "largest speed and acceleration of each axis in the controller's own units, whatever "
        "`step_um` is, in addition to those of `max_speed_mm_s` and `acceleration_mm_s2` "
        "(Zaber: maxspeed, accel; PI: VEL, ACC and DEC; Kinesis: steps/s, steps/s2)",
        gt=0,
        le=1e12,
    )
    mass: float = key(
        "mass_kg", 0.0, "mass that the stage moves; 0: not stated; see `force_n`", ge=0, le=1e6
    )
    force: float = key(
        "force_n",
        0.0,
        "largest force of an axis; 0: not stated. If it, or the weight or the inertia of "
        "`mass_kg`, is above 75 N, `permit` and `heartbeat` are mandatory",
        ge=0,
        le=1e6,
    )
    resume: Literal["person", "auto"] = key(
        "resume",
        "person",
        "who ends a stop: `person`: a person; `auto`: the program, once poses have been found for "
        "50 ms after a stop for want of good samples; stops for any other reason need a person",
    )
    resumes_per_hour: int = key(
        "resumes_per_hour", 6, "largest number of stops in an hour that `auto` ends", ge=1, le=3600
    )
    search_distance: float = key(
        "search_mm",
        0.0,
        "largest distance from the last good place to which the stage searches for a lost mirror, "
        "once a person resumes without a good sample; 0: such a resume is refused",
        ge=0,
        le=MAX_LENGTH_MM,
    )
    search_time: float = key("search_s", 15.0, "longest time of a search", gt=0, le=3600)
    search_reversals: int = key(
        "search_reversals",
        6,
        "number of times that the light may reverse a search before it ends",
        ge=0,
        le=1000,
    )
    permit: str | None = key(
        "permit",
        None,
        "input without which no move is sent: `board` (flag 8 of its frames), "
        "`ni:Dev1/port0/line0`, or `file:PATH` of a file that holds 1",
        **LINE,
    )
    heartbeat: str | None = key(
        "heartbeat",
        None,
        "output for a sign of life while the stage may move: `board` (its port), "
        "`ni:Dev1/port0/line1` (toggles), or `file:PATH`",
        **LINE,
    )
    checked: str | None = key(
        "checked",
        None,
        "date of the wiring check, with the driver, port and step of the checked stage; written "
        "by `acquire --check-stage`",
        max_length=300,
    )


@dataclass(frozen=True)
class Solve:
    """Settings of the solver of poses."""

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
    beam_offset: Pair = key(
        "beam_offset_um",
        (0.0, 0.0),
        "shift of the beam from the position of `known` and `prior`, as `facets rezero` writes it",
        ge=-1e6,
        le=1e6,
    )
    power: Literal["known", "prior", "unknown"] = key(
        "power",
        "known",
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
        "start",
        "zero",
        "initial guess: zero, or the solution of the previous sample",
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
        "whether to output poses without redundancy to check them, such as from two detectors",
    )

    def knowledge(self, sensor: Sensor, position: Floats | None = None) -> Knowledge:
        """Return the prior knowledge of the beam in the form for `facets.solve`.

        The uncertainty of a known beam or power is the laser's own noise (`Electronics.pointing`,
        `power_noise`).  position: (n, 2) or (1, 2) of the beam, mm; by default the origin;
        `beam_offset` is added to it.
        """
        return Knowledge(beam=self._beam(sensor, position), power=self._power(sensor))

    def question(self, knowledge: Knowledge) -> Question:
        """Return the settings of one solve with some prior knowledge of the beam."""
        return Question(
            knowledge.beam, knowledge.power, self.method, self.max_steps,
            accept_unchecked=self.accept_unchecked,
        )  # fmt: skip

    def _beam(self, sensor: Sensor, position: Floats | None) -> BeamKnowledge:
        if self.beam == "free":
            return "free"
        sigma = self.beam_sigma if self.beam == "prior" else 0.0
        sigma = hypot(sigma, sensor.electronics.pointing if sensor.electronics else 0.0)
        if position is None:
            return Prior(self.beam_offset, sigma)
        position = position + self.beam_offset
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
        "Settings of `facets simulate`.",
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


def resolved_text(resolved: dict[str, Any]) -> str:
    """Write resolved keys as compact JSON, whose SHA-256 identifies a configuration; in the order
    of the keys, because motions run in this order."""
    return json.dumps(resolved, separators=(",", ":"), allow_nan=False)


@show_shortly
@dataclass(frozen=True)
class Config:
    """A checked configuration.

    name: file name without suffix.  path: of the file.  electronics: of the detectors, even if the
    noise does not follow from them.  resolved: the same as plain types, with all defaults, in the
    units of the YAML keys.  sha256: checksum of `resolved_text`; equal checksums mean equal
    sensors, motions and settings.
    """

    name: str = field(repr=False)
    path: Path = field(repr=False)
    sensor: Sensor
    motions: dict[str, Motion]
    electronics: Electronics = field(repr=False)
    resolved: dict[str, Any] = field(repr=False)
    sha256: str = field(repr=False)
    noise: bool = item_of(SIMULATE, "noise")
    seed: int = item_of(SIMULATE, "seed")
    solve: Solve = key("solve", {}, "settings of the solver", block=block_of(Solve))
    acquire: Acquire = key("acquire", {}, "the detector board's stream", block=block_of(Acquire))
    stage: Stage = key("stage", {}, "the stage that carries the beam", block=block_of(Stage))
    range: Rules = key("range", {}, "rules of the measurement range", block=block_of(Rules))
    calibrate: Calibrate = key(
        "calibrate", {}, "settings of `facets calibrate`", block=block_of(Calibrate)
    )
    layout: Layout = key("optimize", {}, "settings of `facets optimize`", block=block_of(Layout))
    object: MeasuredObject | None = key(
        "object",
        {},
        "point of interest on the measured object, and the object's axes; without it results "
        "refer to the mirror's apex alone",
        block=block_of(MeasuredObject),
        convert=drop_mirror,
    )

    @property
    def summary(self) -> str:
        """The name, the number of motions, and the sensor."""
        return f"{self.name}, {count_text(len(self.motions), 'motion')}, {self.sensor.summary}"
