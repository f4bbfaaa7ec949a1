"""The inputs of `facets response`, in a recording or a table, and the responses to them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import facets
from facets import core, files, live, responses
from facets.core.errors import InputError

from ..console import load_config
from .recordings import report_clock, solve_recording

if TYPE_CHECKING:
    from facets.config import Config
    from facets.responses.forms import ResponseForm
    from facets.responses.frequency_response import FrequencyResponse
    from facets.responses.signals import Columns, ResponseSignals


class EstimateRequest(NamedTuple):
    """How responses are estimated.  source: of the columns, for messages.  resolution: Hz.
    form: of the responses."""

    settings: Config
    source: str
    resolution: float | None
    corrects_bandwidth: bool
    form: ResponseForm


class InputEstimate(NamedTuple):
    """The responses of the six axes to an input, and their receptances.  name: the input's column.
    unit: of the input."""

    name: str
    unit: str
    signals: ResponseSignals
    receptance: FrequencyResponse
    response: FrequencyResponse


def estimate_inputs(
    columns: Columns, inputs: list[str], request: EstimateRequest
) -> list[InputEstimate]:
    """Estimate the responses to each input, without what goes with the others."""
    return [
        estimate_input(columns, [name, *(other for other in inputs if other != name)], request)
        for name in inputs
    ]


def estimate_input(columns: Columns, inputs: list[str], request: EstimateRequest) -> InputEstimate:
    """Estimate the responses to the first of the inputs, without what goes with the others."""
    settings, name = request.settings, inputs[0]
    body = settings.object or core.rigid_body.MIRROR
    signals = responses.signals.build_signals(columns, inputs, body, settings, request.source)
    delay, unit = responses.signals.describe_input(settings, name)
    estimation = responses.frequency_response
    channel = estimation.OutputChannel(
        signals.deviation, settings.electronics.bandwidth, request.corrects_bandwidth, delay
    )
    receptance = estimation.estimate_response(
        signals.stimulus, signals.motion, signals.stretches, request.resolution, channel,
        signals.others,
    )  # fmt: skip
    return InputEstimate(name, unit, signals, receptance, receptance.convert(request.form))


def read_columns(data: Path, inputs: list[str], config: str | None) -> tuple[Columns, Config]:
    """Read the columns of a recording or of a table, and the sensor's configuration."""
    if data.is_dir() or not data.name.lower().endswith(files.tables.READABLE):
        return solve_columns(data, inputs, config)
    if config is None:
        raise InputError(
            f"{data}: a table needs --config CONFIG, the configuration of the sensor, whose noise "
            "and bandwidth the picture shows"
        )
    columns = responses.signals.read_signal_table(data, inputs)
    report_clock(columns)
    return columns, load_config(config)


def solve_columns(recording: Path, inputs: list[str], config: str | None) -> tuple[Columns, Config]:
    """Solve a recording, which must have the auxiliary channels of the inputs."""
    playback = live.Playback(recording, facets.load(config) if config else None)
    names = [channel.column for channel in playback.config.acquire.channels]
    for column in inputs:
        if column not in names:
            has = ", ".join(names) or "none (acquire.channels names them)"
            raise InputError(
                f"{recording}: has no auxiliary channel with the column {column}; it has: {has}"
            )
    columns = solve_recording(playback)
    if not columns:
        raise InputError(f"{recording}: holds no complete sample")
    return columns, playback.config
