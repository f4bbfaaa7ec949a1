"""National Instruments' cards as a source of samples, by the maker's package `nidaqmx`.

`ni:Dev1/ai0:11?rate=10000` samples twelve voltages by the card's own clock. In the order of the
channels they are the electrodes -y, +y, -z, +z of the detectors A, B and C. Channels after the
twelfth are the auxiliary channels of the configuration, in V. `bits` and `range` convert voltages
to counts and must equal `adc_bits` and `adc_range_v` of `sensor.electronics` (16 and 10 by
default). `terminal` is rse, nrse, diff or default. Not tested on a card: written from the maker's
documentation and source (nidaqmx 1.7).
"""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any
from urllib.parse import parse_qsl

import numpy as np

from ...core.closing import ClosedAtExit
from ...core.extras import require_extra
from ...core.units import Floats
from .frames import ELECTRODES, MAX_CHANNELS, RawSamples, pack
from .source import POLL_S, PortError, PortInUse

CHANNELS = 12
#: Length of the driver's buffer for each channel, s: samples are lost if nobody reads for longer.
BUFFER_S = 10.0
#: A reserved resource: another program has the card.
RESERVED = -50103
TERMINALS = {"rse": "RSE", "nrse": "NRSE", "diff": "DIFF", "default": "DEFAULT"}


def numbers_of(
    name: str, defaults: dict[str, float]
) -> tuple[str, dict[str, float], dict[str, str]]:
    """The place in a port's name, its options with a number or its default, and its other options.

    defaults: the options with numbers, and their defaults. Raises `PortInUse`, because waiting does
    not help, if one of them is not a positive number.
    """
    place, _, query = name.partition("?")
    texts = dict(parse_qsl(query, keep_blank_values=True))
    words = {key: texts.pop(key) for key in list(texts) if key not in defaults}
    try:
        numbers = defaults | {key: float(value) for key, value in texts.items()}
    except ValueError as error:
        raise PortInUse(f"{name}: {error}") from None
    if not all(np.isfinite(value) and value > 0 for value in numbers.values()):
        raise PortInUse(f"{name}: {', '.join(defaults)} must be positive numbers")
    return place.partition(":")[2], numbers, words


def counts_of_volts(volts: Floats, bits: float, full: float) -> Any:
    """Counts of a converter of `bits` bits for `full` volts, clipped to its range; an array of the
    voltages' shape."""
    top = 2**bits - 1
    return np.clip(np.round(volts * (2**bits / full)), -top, top).astype(np.int32)


class Card(ClosedAtExit):
    """A task of the card that samples without end."""

    ended = waits = False

    def __init__(self, name: str, baud: int) -> None:
        """baud: ignored, because a card is no serial line."""
        self.name = name
        channels, options, words = numbers_of(name, {"rate": 10_000, "bits": 16, "range": 10})
        terminal = words.pop("terminal", "default")
        if words or terminal not in TERMINALS or not channels:
            raise PortInUse(
                f"{name}: give ni:DEVICE/ai0:11, and of the options rate, bits, range, "
                f"terminal={'|'.join(TERMINALS)}"
            )
        self.rate, self.bits, self.full = options["rate"], options["bits"], options["range"]
        nidaqmx = require_extra("nidaqmx", name)
        constants = require_extra("nidaqmx.constants", name)
        readers = require_extra("nidaqmx.stream_readers", name)
        self.task: Any = None
        try:
            self.task = nidaqmx.Task()
            self.task.ai_channels.add_ai_voltage_chan(
                channels,
                terminal_config=getattr(constants.TerminalConfiguration, TERMINALS[terminal]),
                min_val=-self.full,
                max_val=self.full,
            )
            self.task.timing.cfg_samp_clk_timing(
                self.rate,
                sample_mode=constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=int(self.rate * BUFFER_S),
            )
            count = len(self.task.ai_channels)
            self.rate = float(self.task.timing.samp_clk_rate)  # what the card can do
            self.task.start()
        except Exception as error:  # the maker's own, also where its driver is not installed
            self.close()
            code = getattr(error, "error_code", None)
            kind = PortInUse if code == RESERVED else PortError
            raise kind(f"{name}: cannot be opened: {error}") from None
        if not CHANNELS <= count <= CHANNELS + MAX_CHANNELS:
            self.close()
            raise PortInUse(
                f"{name}: names {count} channels; needed: {CHANNELS}, four for each detector, and "
                f"up to {MAX_CHANNELS} auxiliary ones after them"
            )
        self.channels = count
        self.reader = readers.AnalogMultiChannelReader(self.task.in_stream)
        self.made = 0

    def read(self) -> bytes:
        """Return the frames that the card has sampled since the last call; empty if there are none.
        Raises `PortError` if the card does not answer or has lost samples."""
        try:
            count = int(self.task.in_stream.avail_samp_per_chan)
            if not count:
                time.sleep(POLL_S)
                return b""
            volts = np.empty((self.channels, count))
            self.reader.read_many_sample(volts, number_of_samples_per_channel=count, timeout=1.0)
        except Exception as error:  # also where nobody has read for BUFFER_S, and samples are lost
            raise PortError(f"{self.name}: went away: {error}") from None
        number = self.made + np.arange(count)
        self.made += count
        counts = counts_of_volts(volts[:CHANNELS].T, self.bits, self.full)
        return frames_of(counts, number, 1e6 * number / self.rate, ELECTRODES, volts[CHANNELS:].T)

    def close(self) -> None:
        task, self.task = self.task, None
        if task is not None:
            with suppress(Exception):
                task.close()


def frames_of(
    counts: Any, number: Any, microseconds: Any, kind: int, channels: Floats | None = None
) -> bytes:
    """Frames of counts (n, 12) with their numbers and times (n,), which wrap, and with auxiliary
    channels (n, m)."""
    none = np.zeros(len(counts), np.uint8)
    return pack(
        RawSamples(
            none + np.uint8(kind),
            none,
            (number % 2**32).astype(np.uint32),
            (np.round(microseconds).astype(np.int64) % 2**32).astype(np.uint32),
            counts,
            None if channels is None else channels.astype(np.float32),
        )
    )
