"""Auxiliary channels from the board to the pose table; see test_frames.py for their bytes, and
test_publication.py for subscribers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from measured import measure
from streams import BENCH, samples_of, yawing

import facets
from facets import Samples
from facets.core import STATE_COLUMNS, STATE_UNITS, AuxiliaryChannel, Calibration, Thermal
from facets.detectors import TEMPERATURE
from facets.estimation import PoseColumns, ZeroRequest, shift_per_kelvin
from facets.live import (
    Bench,
    BenchSetup,
    Pipeline,
    Playback,
    Run,
    RunOptions,
    encode,
    recorded_poses,
)

FORCE = AuxiliaryChannel("force", "N", scale=0.01, offset=0.5)
HEAT = AuxiliaryChannel("temperature", "degC", delay=250e-6)
THERMAL = Thermal(20.0, beam=(2e-3, -1e-3), places=(0.0, -2e-3, 1e-3, -2e-3, 0.0, 3e-3))
READINGS = facets.readings(BENCH.sensor, yawing(600))


def configure(*channels, thermal=None, **options):
    """The bench with channels, a sensor that follows the temperature, and options of `solve`."""
    sensor = replace(BENCH.sensor, thermal=thermal) if thermal else BENCH.sensor
    acquire = replace(BENCH.acquire, channels=channels)
    return replace(BENCH, acquire=acquire, sensor=sensor, solve=replace(BENCH.solve, **options))


def frames(count):
    """Frames with numbers of so many channels, of which some have no value; and these."""
    values = np.random.default_rng(3).normal(size=(600, count)).astype(np.float32)
    values[4::7, :1], values[5::9, 1:] = np.nan, np.inf
    return encode("frames", samples_of(READINGS, channels=values)), values


def test_channels_stand_beside_poses_and_frames_of_another_kind_end_nothing():
    data, values = frames(2)
    pipeline = Pipeline(configure(FORCE, HEAT))
    poses, bare = pipeline.feed(data, 1.0), Pipeline(BENCH).feed(frames(0)[0], 1.0)
    values = np.where(np.isfinite(values), values, np.nan).astype(float)
    np.testing.assert_array_equal(poses.channels["force_n"], 0.5 + 0.01 * values[:, 0])
    np.testing.assert_allclose(poses.channels["temperature_c"], values[:, 1], rtol=1e-7)
    np.testing.assert_array_equal(poses.solution.state, bare.solution.state)
    assert pipeline.feed(frames(0)[0], 2.0) is None
    assert pipeline.parser.corrupt


def warm_stream(temperature):
    """Frames of a mirror that stands still, whose channels are a force and a temperature (n,): the
    readings follow the latter as THERMAL has it, without noise but the converters'."""
    warmer = np.nan_to_num(temperature - THERMAL.reference)[:, None]
    states = np.zeros((len(temperature), 8))
    states[:, 6:] = warmer * THERMAL.beam
    readings = facets.readings(BENCH.sensor, states)
    readings[:, [0, 1, 3, 4, 6, 7]] += warmer * THERMAL.places
    channels = np.column_stack([0 * temperature, temperature])
    return encode("frames", samples_of(readings, channels=channels))


@pytest.mark.parametrize("beam", ["known", "free"])
def test_a_sensor_that_follows_the_temperature_takes_it_from_its_channel(beam):
    """Without it each kelvin shifts the poses by what `shift_per_kelvin` says. Samples that have no
    temperature, or one in kelvin, have no pose; they are counted and named."""
    temperature = np.concatenate([np.full(20, np.nan), np.linspace(17.0, 24.0, 400)])
    temperature[9] = 293.15
    config, data = configure(FORCE, HEAT, thermal=THERMAL, beam=beam), warm_stream(temperature)
    pipeline, cold_states = Pipeline(config), []
    pipeline.board.came = 1
    pipeline.board.compare = lambda _, solution: cold_states.append(solution.state)
    solution = pipeline.feed(data, 1.0).solution
    known = np.arange(420) >= 20
    np.testing.assert_array_equal(solution.converged, known)
    sentences = " ".join(pipeline.measurement.sentences())
    assert "20 samples have no value of temperature_c" in sentences
    (text,) = pipeline.doubts.sentences()
    assert text.startswith("5 % of the newest samples have no value of temperature_c")
    sigma = solution.uncertainty[known, :6].mean(axis=0)
    poses = solution.state[known, :6] / sigma
    assert np.abs(poses).max() < 4  # the converters' steps
    assert np.abs(np.polyfit(temperature[known], poses, 1)[0]).max() < 0.1
    cold = Pipeline(configure(FORCE, HEAT, beam=beam)).feed(data, 1.0).solution.state
    slope = np.polyfit(temperature[known], cold[known, :6] / sigma, 1)[0]
    shift = shift_per_kelvin(config.sensor, config.solve) / sigma
    assert slope == pytest.approx(shift, rel=0.01, abs=0.1)
    assert np.abs(shift).max() > 1
    # the code of a board does not follow the temperature
    np.testing.assert_array_equal(np.concatenate(cold_states), cold)


def temperature_sentence(config):
    """What is said of the temperature after a few samples."""
    pipeline = Pipeline(config)
    named = config.acquire.channels
    pipeline.feed(warm_stream(np.full(20, 20.0)) if named else frames(0)[0], 1.0)
    return pipeline.tally.temperature_sentence(config)


def test_a_run_without_a_temperature_that_the_sensor_follows_says_what_it_costs():
    config = configure(thermal=THERMAL)
    text = temperature_sentence(config)
    assert text.startswith("acquire.channels names no channel temperature_c, though")
    shift = np.abs(shift_per_kelvin(config.sensor, config.solve))
    assert f"up to {1e3 * shift[:3].max():.2g} µm and" in text
    for config in (BENCH, configure(FORCE, HEAT, thermal=THERMAL)):
        assert temperature_sentence(config) == ""


def test_a_zero_is_measured_at_its_temperature():
    """The mirror stands still while everything warms up: its displacement stays 0."""
    config = configure(FORCE, HEAT, thermal=THERMAL, beam="known")
    covariance = Calibration(TEMPERATURE, tuple(map(tuple, (1e-8 * np.eye(8)).tolist())))
    sensor = replace(config.sensor, calibration=covariance)
    pipeline = Pipeline(replace(config, sensor=sensor), PoseColumns(ZeroRequest(seconds=0.02)))
    columns = pipeline.feed(warm_stream(np.repeat([22.0, 24.0], 250)), 1.0).object
    assert 5 < pipeline.measurement.zero.samples < 251
    late, u, part = (
        np.array([columns[f"{prefix}displacement_{name}"][-100:] for name in STATE_COLUMNS[:6]])
        for prefix in ("", "u_", "u_calibration_")
    )
    assert np.abs(late / u).max() < 4
    # the coefficients' errors shift the zero by 2 K and the last sample by 4 K: by 2 K their step
    samples = Samples(facets.readings(sensor, np.zeros((1, 8))), temperature=np.array([24.0]))
    expected = measure(sensor, config.solve, samples).calibration_uncertainty[0, :6]
    assert part[:, -1] == pytest.approx(expected / np.array(STATE_UNITS[:6]) / 2, rel=0.02)


def test_the_virtual_board_s_channels_are_recorded_and_replayed(tmp_path):
    import pyarrow.parquet as pq

    (tmp_path / "own.yaml").write_text(
        "extends: bench\nacquire: {channels: [{name: force, unit: N, scale: 0.01, offset: 0.5}, "
        "{name: temperature, unit: degC, delay_us: 250}]}\n"
    )
    config = facets.load(tmp_path / "own.yaml")
    options = RunOptions(folder=tmp_path / "rec", samples=300)
    Run.from_config(config, "virtual:rest,rate=2000", options).acquire()
    live, table = recorded_poses(tmp_path / "rec"), tmp_path / "poses.parquet"
    for name, delay in (("force_n", 0.0), ("temperature_c", 250e-6)):
        sine = np.sin(2 * np.pi * (live["seq"] / 2000 + delay))
        np.testing.assert_allclose(live[name], sine, atol=1e-6)
    playback = Playback(tmp_path / "rec")
    sentences, is_same = playback.finish(playback.poses(), table, True, None)
    assert is_same, sentences
    columns = pq.read_table(table)
    np.testing.assert_array_equal(columns["force_n"].to_numpy(), live["force_n"])
    assert columns.schema.metadata[b"delay of temperature_c"] == b"250 us"
    playback.finish(Playback(tmp_path / "rec").poses(), tmp_path / "poses.h5", False, None)
    for frame in map(facets.read_table, (tmp_path / "rec", table, tmp_path / "poses.h5")):
        np.testing.assert_array_equal(frame.force_n, live["force_n"])
        assert frame.attrs["units"]["temperature_c"] == "degC"
        assert frame.attrs["config_sha256"] == config.sha256
        assert frame.status.eq("converged").all()
    (tmp_path / "rec" / "poses.arrows").unlink()
    with pytest.raises(facets.InputError, match="rec: holds no poses; `facets replay"):
        facets.read_table(tmp_path / "rec")


def test_the_virtual_bench_is_as_warm_as_its_readings_and_has_the_signals_of_its_channels(
    tmp_path,
):
    setup = BenchSetup(configure(FORCE, HEAT, thermal=THERMAL), "rest", 2000)
    bench = Bench(replace(setup, signals={"force": lambda times, _: 3.0 + times}), tmp_path)
    raw = bench.board.sample_channels(np.arange(3.0), np.zeros((3, 8)))
    bench.end()
    np.testing.assert_allclose(FORCE.values(raw[:, 0]), [3.0, 4.0, 5.0], atol=1e-6)
    np.testing.assert_array_equal(HEAT.values(raw[:, 1]), THERMAL.reference)
    with pytest.raises(facets.InputError, match="names no channel torque"):
        Bench(replace(setup, signals={"torque": np.sin}), tmp_path)
