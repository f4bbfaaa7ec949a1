"""A recording with known noise, through the command: found, told, and put to use."""

import numpy as np
import pandas as pd
import pytest

import facets
from facets.core import READING_COLUMNS, STATE_COLUMNS
from facets.detectors import readings_to_counts
from facets.live import RawSamples, pack
from facets.noise_analysis import noise_report
from facets.responses import build_signals

RATE, COUNT = 1000, 1 << 13
CENTROID, POWER, MAINS = 5e-3, 1e-4, 2e-3  # mm, mW, mm
TIME = np.arange(COUNT) / RATE
BENCH = facets.load("bench")
REST = facets.readings(BENCH.sensor, np.zeros(8))
NOISE = np.tile([CENTROID, CENTROID, POWER], 3)


def stream(yaw=0.0, shared=0.0):
    """The bytes of a mirror whose readings have white noise, one of them a drift, one mains, and
    whose zetas share some."""
    states = np.zeros((COUNT, 8))
    states[:, 5] = yaw
    readings = facets.readings(BENCH.sensor, states)
    readings += NOISE * np.random.default_rng(8).standard_normal((COUNT, 9))
    readings[:, 1::3] += shared * np.random.default_rng(9).standard_normal((COUNT, 1))
    readings[:, 4] += MAINS * np.sin(2 * np.pi * 50 * TIME)
    readings[:, 0] += 1e-3 * TIME
    counts = readings_to_counts(BENCH.sensor, BENCH.electronics, readings)
    number = np.arange(COUNT, dtype=np.uint32)
    kind = np.ones(COUNT, np.uint8)
    whole = RawSamples(kind, 0 * kind, number, 1000 * number, counts)
    return pack(whole.where((number < 5000) | (number >= 5003)))


@pytest.fixture
def record(run_in_process, tmp_path):
    """Records the bytes of a board and returns who runs commands on the recording."""

    def record(data):
        (tmp_path / "board.bin").write_bytes(data)
        run_in_process("acquire", "bench", "--port", "file:board.bin", "-d", "rec", "--plain")
        return lambda *words: run_in_process("noise", "rec", *words)

    return record


@pytest.mark.slow
def test_known_noise_is_found_and_the_configuration_takes_it(record, tmp_path):
    import pandas

    run = record(stream())
    status, out, _ = run("--folder", "noise", "--write", "noise.yaml")
    assert status == 0
    assert "go together" not in out
    assert f"{COUNT - 3:,} samples, 8.191 s at 1000 Hz, 3 missing" in out
    table = pandas.read_csv(tmp_path / "noise" / "noise.csv", comment="#", index_col="channel")
    assert table.sigma_white["zeta_c_mm"] == pytest.approx(1e3 * CENTROID, rel=0.05)
    assert "mains 50 Hz" in table.lines["zeta_b_mm"]
    assert 0 < table.drift_low["psi_a_mm"] < 1 < table.drift_high["psi_a_mm"]
    assert (tmp_path / "noise" / "noise.html").read_text().count("<svg") == 3
    assert "extends: bench\n" in (tmp_path / "noise.yaml").read_text()
    sensor = facets.load(tmp_path / "noise.yaml").sensor
    assert facets.standard_deviations(sensor, REST) == pytest.approx(NOISE, rel=0.1)


@pytest.mark.slow
def test_noise_that_detectors_share_is_told(record):
    _, out, _ = record(stream(shared=CENTROID))()
    assert "The noises of detectors are correlated (0.5" in out
    assert "3 pairs in all" in out


@pytest.mark.slow
def test_a_recording_that_does_not_show_the_noise_is_refused_and_leaves_nothing(record, tmp_path):
    """One of a moving mirror, and one that is too short."""
    run = record(stream(yaw=1e-3 * np.sin(TIME / 0.3)))
    status, out, _ = run("--folder", "new/noise", "--write", "new/n.yaml")
    assert status == 1
    assert "All detectors change as when the mirror moves, mostly in yaw" in out
    assert "Not written: new/noise/, new/n.yaml." in out
    assert not (tmp_path / "new").exists()
    status, out, _ = run("--folder", "noise")
    assert (status, "position_um" in out) == (1, False)
    page = (tmp_path / "noise" / "noise.html").read_text()
    assert "he noise of the bench cannot be estimated from this recording" in page
    assert "For the configuration" not in page
    columns = {"seq": np.arange(20), "board_us": np.arange(20)}
    with pytest.raises(facets.InputError, match="too few for their noise"):
        noise_report.longest_section(columns, "it")


@pytest.mark.parametrize("pace", [10.0, 1.01, 1e-2])
def test_the_rate_of_a_recording_is_that_of_its_arrivals(pace):
    """Where the board's clock is off by more than a quartz, also in frequency responses and signals
    for other programs."""
    rows = np.arange(4096)
    columns = {"seq": rows, "board_us": np.round(1e3 * pace * rows), "host_s": 50 + 1e-3 * rows}
    assert noise_report.longest_section(columns, "it").rate == pytest.approx(1000, rel=1e-3)
    columns |= {name: np.zeros(4096) for name in (*STATE_COLUMNS, "force_n")}
    signals = build_signals(columns, ["force_n"], BENCH, "it")
    assert signals.stretches.rate == pytest.approx(1000, rel=1e-3)
    table = pd.DataFrame(columns)
    assert facets.to_sep005(table)[0]["fs"] == pytest.approx(1000, rel=1e-3)
    table["board_us"] = 5
    with pytest.raises(facets.InputError, match="does not advance"):
        facets.to_sep005(table)


def test_a_calibration_does_not_scatter_at_rest():
    """What is measured at rest stands beside the noise alone, where a table tells it apart."""
    noise = NOISE * np.random.default_rng(3).standard_normal((4096, 9))
    columns = dict(zip(READING_COLUMNS, (REST + noise).T, strict=True))
    for name in STATE_COLUMNS[:6]:
        columns |= {name: noise[:, 3], f"u_{name}": np.full(4096, 2e-3)}
    columns |= {"seq": np.arange(4096), "board_us": 1000 * np.arange(4096)}
    columns |= {"flags": np.zeros(4096, np.uint8), "u_noise_tz_mm": np.full(4096, 1e-3)}
    report = noise_report.report_of(columns, BENCH, "it")
    assert report.channel("tz_mm").configured == pytest.approx(1.0)
    assert report.channel("tx_mm").configured == pytest.approx(2.0)
