"""The motions of a configuration: frozen, in the units of the code (mm, rad, s)."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from math import inf
from pathlib import Path
from typing import Any, ClassVar, Literal

from .axis_keys import BOX, COMPLIANCE, CYCLES, PHASES, PLACE, Pose, State
from .keys import block_of, key

SAMPLES: dict[str, Any] = {"meaning": "number of readings", "ge": 1, "le": 1_000_000_000}
RATE: dict[str, Any] = {"gt": 0, "le": 1e9}


@dataclass(frozen=True)
class Steps:
    """Dwells at equally spaced places from start to stop, both included."""

    kind: ClassVar[str] = "steps"
    start: State = key("from", {}, "first place", block=PLACE)
    stop: State = key("to", {}, "last place", block=PLACE)
    steps: int = key("steps", 21, "number of places", ge=1, le=1_000_000)
    samples_per_step: int = key("samples_per_step", 1, "readings at each place", ge=1, le=1_000_000)
    rate: float = key("rate_hz", 1000.0, "readings per second", **RATE)

    @property
    def samples(self) -> int:
        return self.steps * self.samples_per_step


@dataclass(frozen=True)
class Sweep:
    """Uniform motion of all axes from one place to another, both included."""

    kind: ClassVar[str] = "sweep"
    start: State = key("from", {}, "first place", block=PLACE)
    stop: State = key("to", {}, "last place", block=PLACE)
    samples: int = key("samples", 401, **SAMPLES)
    rate: float = key("rate_hz", 1000.0, "readings per second", **RATE)


@dataclass(frozen=True)
class Sine:
    """Sinusoid of each axis: centre + amplitude sin(2 pi cycles s + phase), s from 0 to 1."""

    kind: ClassVar[str] = "sine"
    centre: State = key("centre", {}, "middle of the swing", block=PLACE)
    amplitude: State = key("amplitude", {}, "half the swing", block=PLACE)
    cycles: State = key("cycles", {}, "periods over the whole motion", block=CYCLES)
    phase: State = key("phase_deg", {}, "phase of each axis at the beginning", block=PHASES)
    samples: int = key("samples", 1000, **SAMPLES)
    rate: float = key("rate_hz", 1000.0, "readings per second", **RATE)


@dataclass(frozen=True)
class Random:
    """Independent states, uniformly distributed in a box."""

    kind: ClassVar[str] = "random"
    centre: State = key("centre", {}, "middle of the box", block=PLACE)
    box: State = key("box", {}, "half-width of the box on each axis", block=BOX)
    samples: int = key("samples", 1000, **SAMPLES)
    rate: float = key("rate_hz", 1000.0, "readings per second", **RATE)


@dataclass(frozen=True)
class Table:
    """States from a CSV file: columns tx_mm ... yaw_mrad, optionally bx_mm, by_mm and time_s."""

    kind: ClassVar[str] = "table"
    file: Path = key(
        "file",
        MISSING,
        "CSV file; a relative path starts at this configuration's folder",
        min_length=1,
        convert=Path,
    )
    samples_per_step: int = key(
        "samples_per_step",
        1,
        "readings at each row; 1 if the file has time_s",
        ge=1,
        le=1_000_000,
    )
    rate: float = key("rate_hz", 1000.0, "readings per second if the file has no time_s", **RATE)


@dataclass(frozen=True)
class Mode:
    """A mode of vibration, with the displacement of the mirror in it by a static force of 1 N."""

    frequency: float = key("frequency_hz", MISSING, "undamped natural frequency", gt=0, le=1e6)
    damping: float = key("damping_percent", 1.0, "damping relative to critical", gt=0, lt=100)
    compliance: Pose = key("per_newton", {}, "displacement by a static force", block=COMPLIANCE)


@dataclass(frozen=True)
class Vibration:
    """A body on springs that a shaker drives; the force is the auxiliary channel force_n.

    Force and displacement repeat without a transient, so that their ratio at each harmonic of the
    repetition is the response of the modes.
    """

    kind: ClassVar[str] = "vibration"
    modes: dict[str, Mode] = key(
        "modes", MISSING, "modes of vibration, by name", named=block_of(Mode)
    )
    centre: State = key("centre", {}, "place without a force", block=PLACE)
    drive: Literal["random", "burst", "sweep"] = key(
        "drive",
        "random",
        "random: noise in the band; burst: such noise in the first half only, each time; sweep: a "
        "sinusoid whose frequency passes through the band",
    )
    force: float = key("force_n", 1.0, "root mean square of the force", gt=0, le=1e6)
    low: float = key("from_hz", 1.0, "lower end of the band", ge=0, le=1e6)
    high: float = key("to_hz", None, "upper end; null: 0.4 of rate_hz", gt=0, le=1e6, null=inf)
    samples: int = key("samples", 20_000, **SAMPLES)
    rate: float = key("rate_hz", 1000.0, "readings per second", **RATE)


@dataclass(frozen=True)
class Runs:
    """Repeated runs of an axis with known errors to equally spaced places and back.

    The axis dwells at each place and overruns both ends, so that every place is approached from
    both sides.
    """

    kind: ClassVar[str] = "runs"
    start: State = key("from", {}, "first commanded place", block=PLACE)
    stop: State = key("to", {}, "last commanded place", block=PLACE)
    steps: int = key("steps", 11, "number of places", ge=2, le=10_000)
    runs: int = key("runs", 5, "number of runs there and back", ge=1, le=1000)
    dwell: float = key("dwell_ms", 300.0, "time at each place", gt=0, le=1e6)
    move: float = key("move_ms", 100.0, "time from one place to the next", gt=0, le=1e6)
    overrun: float = key(
        "overrun_percent", 50.0, "overrun of an end, relative to one step", gt=0, le=1000
    )
    scale: float = key(
        "scale_percent", 0.0, "error relative to the distance from the middle", ge=-100, le=100
    )
    wave: State = key("wave", {}, "amplitude of periodic errors, such as of a screw", block=PLACE)
    periods: float = key(
        "periods", 3.0, "periods of `wave` from the first place to the last", ge=0, le=1e6
    )
    bow: State = key("bow", {}, "errors at the middle that vanish at both ends", block=PLACE)
    backlash: State = key(
        "backlash", {}, "place at positive minus place at negative approach", block=PLACE
    )
    scatter: State = key("scatter", {}, "standard deviation from visit to visit", block=BOX)
    rate: float = key("rate_hz", 1000.0, "readings per second", **RATE)


Motion = Steps | Sweep | Sine | Random | Table | Vibration | Runs
KINDS = (Steps, Sweep, Sine, Random, Table, Vibration, Runs)
