"""Auxiliary channels from the board to the pose table; see test_frames.py for their bytes."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pyarrow.parquet as pq
import pytest
from facets.experiments import kills

import facets
from facets.core import (
    READING_COLUMNS,
    STATE_COLUMNS,
    STATE_UNITS,
    AuxiliaryChannel,
    Calibration,
    InputError,
    Thermal,
)
from facets.detectors import TEMPERATURE, readings_to_counts
from facets.estimation import (
    ZeroRequest,
    add_temperature_uncertainty,
    labels,
    pose_columns,
    shift_per_kelvin,
    solve_table,
)
from facets.files import read_chunks, write_table
from facets.live import (
    SAMPLE,
    Bench,
    Faults,
    Pipeline,
    Playback,
    Publications,
    Run,
    Samples,
    description,
    encode,
    join_poses,
    parser,
    recorded_poses,
    row_content,
    rows_of,
    sample_dtype,
)
from facets.live.streams.json_rows import json_of
from facets.live.streams.row_stream import same_columns
from facets.live.streams.subscription import Subscription

BENCH = facets.load("bench")
FORCE = AuxiliaryChannel("force", "N", scale=0.01, offset=0.5)
HEAT = AuxiliaryChannel("temperature", "degC", delay=250e-6)


def with_channels(*channels, form="frames"):
    return replace(BENCH, acquire=replace(BENCH.acquire, channels=channels, format=form))


def channel_stream(count: int) -> tuple[Samples, np.ndarray]:
    """Samples with two channels, of which some have no value."""
    samples = parser("frames", "electrodes").feed(kills.stream(count))
    values = np.random.default_rng(3).normal(size=(count, 2)).astype(np.float32)
    values[4::7, 0], values[5::9, 1] = np.nan, np.inf
    return replace(samples, channels=values), values


@pytest.mark.parametrize("form", ["frames", "cobs", "text"])
def test_channels_stand_beside_poses_and_never_change_them(form):
    samples, values = channel_stream(600)
    config = with_channels(FORCE, HEAT, form=form)
    data, pipeline = encode(form, samples), Pipeline(config)
    cuts = [0, 1000, 1001, 30_000, len(data)]
    parts = [pipeline.feed(data[a:b], 1e-4 * b) for a, b in pairwise(cuts)]
    found = join_poses([part for part in parts if part is not None])
    force = np.where(np.isfinite(values[:, 0]), 0.5 + 0.01 * values[:, 0].astype(float), np.nan)
    np.testing.assert_array_equal(found.channels["force_n"], force)
    heat = np.where(np.isfinite(values[:, 1]), values[:, 1], np.nan)
    np.testing.assert_allclose(found.channels["temperature_c"], heat, rtol=1e-7)
    bare = Pipeline(BENCH).feed(kills.stream(600), 1.0)
    np.testing.assert_array_equal(found.solution.state, bare.solution.state)
    np.testing.assert_array_equal(found.solution.status, bare.solution.status)


THERMAL = Thermal(20.0, beam=(2e-3, -1e-3), places=(0.0, -2e-3, 1e-3, -2e-3, 0.0, 3e-3))


def warm_stream(state, temperature):
    """Frames of the bench, whose channels are a force and a temperature (n,): the readings of one
    state (8,) follow the temperature as THERMAL has it, without noise but the converters'."""
    warmer = np.nan_to_num(temperature - THERMAL.reference)[:, None]
    states = state + warmer * np.array([0, 0, 0, 0, 0, 0, *THERMAL.beam])
    readings = facets.readings(BENCH.sensor, states)
    readings[:, [0, 1, 3, 4, 6, 7]] += warmer * np.array(THERMAL.places)
    counts = readings_to_counts(BENCH.sensor, BENCH.electronics, readings, None)
    samples, _ = channel_stream(len(counts))
    channels = np.column_stack([np.zeros(len(counts)), temperature]).astype(np.float32)
    return encode("frames", replace(samples, counts=counts, channels=channels))


@pytest.mark.parametrize("beam", ["known", "free"])
def test_a_sensor_that_follows_the_temperature_takes_it_from_its_channel(beam):
    """Without it each kelvin shifts the poses by what `shift_per_kelvin` says."""
    state = np.zeros(8)
    temperature = np.linspace(17.0, 24.0, 400)
    temperature[7] = np.nan
    config = with_channels(FORCE, HEAT)
    solve = replace(config.solve, beam=beam, beam_offset=(0.0, 0.0))
    config = replace(config, sensor=replace(config.sensor, thermal=THERMAL), solve=solve)
    data = warm_stream(state, temperature)
    found = Pipeline(config).feed(data, 1.0).solution
    assert np.flatnonzero(~found.converged).tolist() == [7]
    known = np.isfinite(temperature)
    warmer = temperature[known] - THERMAL.reference
    sigma = found.uncertainty[known, :6].mean(axis=0)

    def slopes(state_of_each):
        return np.polyfit(warmer, state_of_each[known, :6], 1)[0] / sigma

    assert np.abs((found.state - state)[known, :6] / sigma).max() < 4  # the converters' steps
    assert np.abs(slopes(found.state)).max() < 0.1
    assert Pipeline(config).temperature_sentence() == ""
    cold = replace(config, sensor=replace(config.sensor, thermal=Thermal(20.0)))
    off = slopes(Pipeline(cold).feed(data, 1.0).solution.state)
    assert off == pytest.approx(shift_per_kelvin(config.sensor, solve) / sigma, rel=0.01, abs=0.1)
    assert np.abs(off).max() > 1


def test_samples_without_a_temperature_are_counted_and_named():
    config = with_channels(FORCE, HEAT)
    config = replace(config, sensor=replace(config.sensor, thermal=THERMAL))
    temperature = np.full(400, 21.0)
    temperature[5:25] = np.nan
    temperature[9] = 293.15  # in kelvin
    pipeline = Pipeline(config)
    found = pipeline.feed(warm_stream(np.zeros(8), temperature), 1.0).solution
    assert np.array_equal(~found.converged, temperature != 21.0)
    assert pipeline.temperature_sentence().startswith("20 samples have no value of temperature_c")
    (text,) = pipeline.doubts.sentences()
    assert text.startswith("5 % of the newest samples have no value of temperature_c")


def test_a_table_that_a_replay_wrote_is_solved_to_the_same_poses(tmp_path):
    """Its place of the beam contains what follows the temperature, and the offset."""
    config = with_channels(FORCE, HEAT)
    solve = replace(config.solve, beam="known", beam_offset=(0.003, -0.002))
    config = replace(config, sensor=replace(config.sensor, thermal=THERMAL), solve=solve)
    state = np.array([0, 0, 0, 0, 0, 0, 0.003, -0.002])
    found = Pipeline(config).feed(warm_stream(state, np.linspace(17, 24, 400)), 1.0)
    table = tmp_path / "replayed.csv"
    columns = dict(zip(READING_COLUMNS, found.readings.T, strict=True))
    columns |= {"temperature_c": found.channels["temperature_c"]}
    columns |= pose_columns(found.solution, labels(found.solution, np.zeros(400, dtype=bool)))
    write_table(table, columns, {})
    again = tmp_path / "again.csv"
    counts = solve_table(config, config.solve, table, again, {})
    assert counts.misfit.flagged <= 1
    whole = np.concatenate([[part.columns[name] for name in STATE_COLUMNS]
                            for part in read_chunks(again, STATE_COLUMNS)], axis=1)  # fmt: skip
    assert np.abs(whole.T * STATE_UNITS - found.solution.state).max() < 1e-9


def test_a_board_s_poses_are_compared_with_those_without_the_temperature():
    """Because its code does not follow it."""
    config = with_channels(FORCE, HEAT)
    config = replace(config, sensor=replace(config.sensor, thermal=THERMAL))
    pipeline = Pipeline(config)
    pipeline.board.came = 1
    compared = []
    pipeline.board.compare = lambda seq, solution: compared.append(solution.state)
    data = warm_stream(np.zeros(8), np.full(250, 24.0))
    here = pipeline.feed(data, 1.0).solution.state
    cold = replace(config, sensor=replace(config.sensor, thermal=Thermal(20.0)))
    expected = Pipeline(cold).feed(data, 1.0).solution.state
    np.testing.assert_array_equal(compared[0], expected)
    assert np.abs(here - expected).max() > 1e-4


def test_a_run_without_a_temperature_that_the_sensor_follows_says_what_it_costs():
    sensor = replace(BENCH.sensor, thermal=THERMAL)
    config = replace(BENCH, sensor=sensor)
    text = Pipeline(config).temperature_sentence()
    assert text.startswith("acquire.channels names no channel temperature_c, though")
    shift = np.abs(shift_per_kelvin(sensor, config.solve))
    assert f"up to {1e3 * shift[:3].max():.2g} um and" in text
    assert Pipeline(BENCH).temperature_sentence() == ""


@pytest.mark.parametrize(("sent", "named"), [(2, 0), (2, 1), (0, 2)])
def test_a_configuration_with_other_channels_ends_with_what_to_do(sent, named):
    samples, _ = channel_stream(60)
    data = encode("frames", replace(samples, channels=samples.channels[:, :sent]))
    pipeline = Pipeline(with_channels(*(FORCE, HEAT)[:named]))
    with pytest.raises(InputError, match=f"has {sent} auxiliary .* names {named}: .* replay"):
        pipeline.feed(data, 1.0)


def test_published_rows_and_texts_have_the_channels_with_their_units():
    samples, _ = channel_stream(100)
    config = with_channels(FORCE, HEAT)
    poses = Pipeline(config).feed(encode("frames", samples), 1.0)
    rows, about = rows_of(poses, 5.0), description(row_content(config))
    assert rows.dtype == sample_dtype(about)
    assert about["units"]["force_n"] == "N"
    assert about["units"]["temperature_c"] == "degC"
    assert [one["delay_us"] for one in about["channels"]] == [0.0, pytest.approx(250.0)]
    for column in ("force_n", "temperature_c"):
        np.testing.assert_array_equal(rows[column], poses.channels[column])
    np.testing.assert_array_equal(rows["residual"], poses.solution.residual)
    texts = [json.loads(text) for text in json_of(rows)]
    assert texts[0]["channels"]["force_n"] == pytest.approx(rows["force_n"][0], rel=1e-8)
    assert "force_n" not in texts[4]["channels"]  # it has no value
    assert texts[4]["pose"].keys() == texts[0]["pose"].keys()
    with (
        Publications(["zmq://127.0.0.1:0"], config, True, utc_offset=5.0) as publications,
        Subscription(publications.places()[0]) as subscription,
    ):
        publications.add_poses(poses)
        came = next(iter(subscription))
    assert came.tobytes() == rows[: len(came)].tobytes()
    assert same_columns(rows).dtype == SAMPLE


def test_frames_of_another_kind_in_the_middle_end_nothing():
    samples, _ = channel_stream(60)
    pipeline = Pipeline(with_channels(FORCE, HEAT))
    whole = pipeline.feed(encode("frames", samples.where(slice(0, 40))), 1.0)
    bare = replace(samples.where(slice(40, 60)), channels=samples.channels[40:60, :0])
    assert pipeline.feed(encode("frames", bare), 2.0) is None
    assert len(whole) == 40
    assert pipeline.parser.corrupt


@pytest.mark.slow
def test_the_virtual_board_s_channels_are_recorded_and_replayed(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(
        "extends: bench\nacquire: {channels: [{name: force, unit: N, scale: 0.01, offset: 0.5}, "
        "{name: temperature, unit: degC, delay_us: 250}]}\n"
    )
    config = facets.load(path)

    def force(times, states):
        return 3.0 + times + states[:, 0]

    bench = Bench(
        config, "rest", 2000, Faults(), 1, tmp_path / "b", truth=True, signals={"force": force}
    )
    thread = threading.Thread(target=bench.run, args=(60.0,))
    thread.start()
    try:
        run = Run.from_config(
            config, str(tmp_path / "b" / "board"), folder=tmp_path / "rec", samples=1500
        )
        run.acquire()
    finally:
        bench.last = np.inf
        thread.join()
    live = recorded_poses(tmp_path / "rec")
    times = live["seq"] / 2000
    np.testing.assert_allclose(live["force_n"], 3.0 + times, atol=1e-6)
    sine = np.sin(2 * np.pi * (times + 250e-6))
    np.testing.assert_allclose(live["temperature_c"], sine, atol=1e-6)
    playback = Playback(tmp_path / "rec")
    table = tmp_path / "poses.parquet"
    sentences, is_same = playback.finish(playback.poses(), table, None, True, None)
    assert is_same, sentences
    columns = pq.read_table(table)
    np.testing.assert_array_equal(columns["force_n"].to_numpy(), live["force_n"])
    assert columns.schema.field("force_n").metadata == {b"unit": b"N"}
    assert columns.schema.metadata[b"delay of temperature_c"] == b"250 us"
    assert_in_mcap(playback, tmp_path / "poses.mcap", live["force_n"])


def assert_in_mcap(playback, path, force):
    reader = pytest.importorskip("mcap.reader")
    list(playback.write(path, playback.poses(), None))
    with path.open("rb") as file:
        found = list(reader.make_reader(file).iter_messages(topics=["/facets/sample"]))
    schema = json.loads(found[0][0].data)
    assert schema["properties"]["channels"]["properties"]["force_n"]["description"] == "N"
    values = [json.loads(message.data)["channels"]["force_n"] for _, _, message in found]
    np.testing.assert_allclose(values, force, rtol=1e-8)


def test_the_virtual_bench_is_as_warm_as_its_readings(tmp_path):
    config = with_channels(FORCE, HEAT)
    config = replace(config, sensor=replace(config.sensor, thermal=THERMAL))
    bench = Bench(config, "rest", 2000, Faults(), 1, tmp_path / "b")
    try:
        raw = bench.board.sample_channels(np.arange(3.0), np.zeros((3, 8)))
    finally:
        bench.end()
    np.testing.assert_array_equal(HEAT.values(raw[:, 1]), THERMAL.reference)


def test_a_zero_is_measured_at_its_temperature():
    """The mirror stands still while everything warms up: its displacement stays 0."""
    config = with_channels(FORCE, HEAT)
    solve = replace(config.solve, beam="known", beam_offset=(0.0, 0.0))
    known = Calibration(TEMPERATURE, tuple(map(tuple, (1e-8 * np.eye(8)).tolist())))
    sensor = replace(config.sensor, thermal=THERMAL, calibration=known)
    config = replace(config, sensor=sensor, solve=solve)
    pipeline = Pipeline(config, zero=ZeroRequest(seconds=0.02))
    temperature = np.repeat([22.0, 24.0], 250)
    found = pipeline.feed(warm_stream(np.zeros(8), temperature), 1.0).object
    zero = pipeline.object_poses.zero
    assert 5 < zero.samples < 251
    late = np.array([found[f"displacement_{name}"][-100:] for name in STATE_COLUMNS[:6]])
    u = np.array([found[f"u_displacement_{name}"][-100:] for name in STATE_COLUMNS[:6]])
    assert np.abs(late / u).max() < 4
    # the coefficients' errors shift the zero by 2 K and the last sample by 4 K: by 2 K their step
    part = np.array([found[f"u_calibration_displacement_{name}"][-1] for name in STATE_COLUMNS[:6]])
    warmer = np.array([4.0])
    alone = add_temperature_uncertainty(
        sensor, solve, solve.knowledge(sensor),
        facets.solve(sensor, facets.readings(sensor, np.zeros((1, 8))), beam="known"),
        THERMAL.reference + warmer,
    ).calibration_uncertainty[0, :6]  # fmt: skip
    assert part == pytest.approx(alone / np.array(STATE_UNITS[:6]) / 2, rel=0.02)


def test_a_signal_without_a_channel_is_refused(tmp_path):
    with pytest.raises(InputError, match="names no channel torque"):
        Bench(
            with_channels(FORCE), "rest", 2000, Faults(), 1, tmp_path / "b",
            signals={"torque": lambda times, states: times},
        )  # fmt: skip
