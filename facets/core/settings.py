"""What a configuration becomes: frozen, in the units of the code (mm, rad, mW, s)."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from .rules import Rules
from .sensor import Electronics, Sensor

#: tx, ty, tz (mm), roll, pitch, yaw (rad), bx, by (mm): the state of Eq. (3).
State = tuple[float, float, float, float, float, float, float, float]


@dataclass(frozen=True)
class Steps:
    """Stands still at `steps` equally spaced places from `start` to `stop`, both included.

    samples_per_step: readings taken at each place.  rate: of the samples, Hz.
    """

    kind: ClassVar[str] = "steps"
    start: State
    stop: State
    steps: int
    samples_per_step: int
    rate: float

    @property
    def samples(self) -> int:
        return self.steps * self.samples_per_step


@dataclass(frozen=True)
class Sweep:
    """Moves evenly from `start` to `stop`, both included, all axes at once.  rate: Hz."""

    kind: ClassVar[str] = "sweep"
    start: State
    stop: State
    samples: int
    rate: float


@dataclass(frozen=True)
class Sine:
    """centre + amplitude sin(2 pi cycles s + phase), each axis on its own, s from 0 up to 1.

    cycles: periods over the whole motion.  phase: rad.  rate: Hz.
    """

    kind: ClassVar[str] = "sine"
    centre: State
    amplitude: State
    cycles: State
    phase: State
    samples: int
    rate: float


@dataclass(frozen=True)
class Random:
    """Independent states, uniform in centre +- box.  rate: Hz."""

    kind: ClassVar[str] = "random"
    centre: State
    box: State
    samples: int
    rate: float


@dataclass(frozen=True)
class Table:
    """States from a CSV file; its columns are the axis keys (tx_mm ...), time_s if given.

    file: absolute path.  samples_per_step: of each row, and rate: of samples, Hz, both where the
    file has no time_s.
    """

    kind: ClassVar[str] = "table"
    file: Path
    samples_per_step: int
    rate: float


Motion = Steps | Sweep | Sine | Random | Table


@dataclass(frozen=True)
class Solve:
    """How readings are solved; the words are those of `facets.solve`.

    beam: "free", "known" or "prior", which holds it to the given position within `beam_sigma`, mm.
    power: "unknown", "known" or "prior", which holds it to the sensor's within `power_sigma`, a
    share.  accept_unchecked: whether to give poses that no number is left to check.
    """

    beam: str
    beam_sigma: float
    power: str
    method: str
    start: str
    max_steps: int
    power_sigma: float = 0.01
    accept_unchecked: bool = False


@dataclass(frozen=True)
class Acquire:
    """The detector board's stream.

    dark: counts without light.  timing: "envelope" or "arrival".  mark: "trigger" or "pps".
    least_delay, delay: s.  wait: for a port that is not there yet, s.  sync: what a power failure
    may cost a recording, s; 0 for whatever the system leaves.
    """

    port: str | None
    baud: int
    format: str
    content: str
    dark: float
    timing: str
    least_delay: float
    delay: float
    wait: float
    sync: float
    mark: str = "trigger"


@dataclass(frozen=True)
class Stage:
    """The stage that carries the beam; mm, mm/s, s.

    zero: the beam's place at the stage's zero.  low, high: soft limits in the stage's coordinates.
    step: one native unit.  accuracy: of the encoder, 1 sigma.  gain, integral: per command.
    bridge, bridge_distance: for how long and how far a mirror's motion may be predicted.
    resume: "person" or "auto".  permit, heartbeat: lines, None where there is none.  checked: date,
    driver, port and step of the stage whose wiring was checked.
    """

    driver: str
    port: str | None
    baud: int
    step: float
    zero: tuple[float, float]
    low: tuple[float, float]
    high: tuple[float, float]
    max_speed: float
    max_step: float
    rate: float
    accuracy: float
    law: str
    gain: float
    integral: float
    stale: float
    bridge: float
    bridge_distance: float
    lag: float
    latency: float
    acceleration: float
    resume: str
    resumes_per_hour: int
    permit: str | None
    heartbeat: str | None
    checked: str | None


@dataclass(frozen=True)
class PsdPart:
    """A detector that can be had.  size: mm.  position: noise, mm, None as the sensor's.

    price: of one, None where it is not known; as of all parts.  delivery: weeks, likewise.
    """

    size: float
    position: float | None
    price: float | None
    delivery: float | None = None


@dataclass(frozen=True)
class LaserPart:
    """A laser that can be had: mW, mm."""

    power: float
    diameter: float
    price: float | None
    delivery: float | None = None


@dataclass(frozen=True)
class AmplifierPart:
    """Amplifiers that can be had, for all detectors.  power: noise of a power, mW."""

    power: float
    price: float | None
    delivery: float | None = None


@dataclass(frozen=True)
class Layout:
    """What a layout is to be found for; see the keys of `optimize`.

    variables: least and most of each, in the unit of its name.  volume: half widths of the pose and
    of the beam's offset (8,), mm and rad.  unit, limit: (6,) um and urad, infinite where not given.
    head: mm, infinite where it may be any.  least_power: mW.  weights: of the aims, where they
    are weighted.
    psds, lasers, amplifiers: the parts that can be had, by name; empty where any can.
    accuracy: (6,) um and urad, the largest error of a head as built; infinite where not given.
    production: share of the heads that must keep all, 0 where the design alone must.
    calibrated: whether heads are calibrated before they are used, at so many `poses`.
    """

    variables: dict[str, tuple[float, float]]
    psds: dict[str, PsdPart]
    lasers: dict[str, LaserPart]
    volume: State
    aim: str
    weights: dict[str, float]
    unit: tuple[float, ...]
    limit: tuple[float, ...]
    head: float
    least_power: float
    following: bool
    starts: int
    seed: int
    amplifiers: dict[str, AmplifierPart] = field(default_factory=dict)
    accuracy: tuple[float, ...] = (float("inf"),) * 6
    production: float = 0.0
    calibrated: bool = True
    poses: int = 60

    @property
    def has_parts(self) -> bool:
        """Whether a catalogue is laid under the search."""
        return bool(self.psds or self.lasers or self.amplifiers)

    @property
    def aims(self) -> dict[str, float]:
        """What is aimed at, and how much each counts."""
        return self.weights if self.aim == "weighted" else {self.aim: 1.0}


@dataclass(frozen=True)
class Calibrate:
    """What a calibration takes; see the keys of `calibrate`.

    reference: (6,) mm and rad, infinite where an axis is not measured.  before: by key, in its
    unit; what stays is not there.  power_per_sample: whether the laser's power is an unknown of
    each.  effects: by key "auto", "on" or "off".  beam: "given", where the table says that it is,
    or "still", at the origin whatever the table says.  held_back: share of the samples.
    dwells: whether rows are averaged where the reference stands still.
    """

    reference: tuple[float, ...]
    before: dict[str, float]
    power_per_sample: bool
    effects: dict[str, str]
    beam: str
    held_back: float
    outliers: float | None
    dwells: bool = False


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
    noise: bool
    seed: int
    solve: Solve
    acquire: Acquire
    stage: Stage
    electronics: Electronics
    range: Rules
    layout: Layout
    calibrate: Calibrate
    resolved: dict[str, Any]
    sha256: str
