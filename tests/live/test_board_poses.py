"""A board that solves poses itself: its frames beside what is solved here."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from programs import Program

import facets
from facets import firmware
from facets.firmware import FirmwareLibrary
from facets.live import (
    POSE,
    SIZE,
    Bench,
    BenchSetup,
    FixedFrames,
    Pipeline,
    board_solution,
)
from facets.tracking import heartbeat_frame

CONFIG = facets.load("bench")
pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="no C compiler")


def compile_c(folder, *arguments):
    subprocess.run(["gcc", "-O1", "-Wall", "-Werror", *arguments, "-lm"], cwd=folder, check=True)


def compile_library(folder, sensor):
    about = firmware.source.Provenance("test", "0", "test")
    for path, text in firmware.export.export(sensor, about).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    compile_c(folder, "-shared", "-fPIC", "facets.c", "facets_frame.c", "-o", "l.so")
    return folder / "l.so"


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return compile_library(tmp_path_factory.mktemp("firmware"), CONFIG.sensor)


@pytest.fixture
def board(tmp_path, library):
    """Makes virtual boards that solve by a library."""
    benches = []

    def make(path=library):
        solver = FirmwareLibrary(path)
        benches.append(
            Bench(BenchSetup(CONFIG, "wobble", 1e4, firmware=solver), tmp_path / "bench")
        )
        benches[-1].begin = 0.0
        benches[-1].board.switch_on(0.0)
        return benches[-1].board

    yield make
    for bench in benches:
        bench.end()


def send(board, count=600, first=0):
    """The bytes that a board sends of a yawing mirror."""
    seq, states = np.arange(first, first + count), np.zeros((count, 8))
    states[:, 5] = 1e-3 * np.sin(seq / 50)
    return board.encode(board.sample(states, seq, 1e-4 * seq, 0.0))


def fed(data):
    pipeline = Pipeline(CONFIG)
    for n in range(0, len(data), 777):
        pipeline.feed(data[n : n + 777], 1e-4 * n / (2 * SIZE))
    return pipeline


def test_the_boards_poses_are_those_solved_here(board):
    """Frames hold single precision: their rounding is far under the noise."""
    pipeline = fed(send(board()))
    poses = pipeline.board
    assert pipeline.tally.samples == poses.came == poses.compared == 600
    assert poses.statuses == poses.apart == 0
    assert 0 < poses.worst < 0.01
    assert poses.trouble() == ""


def test_a_board_with_the_code_of_another_sensor_is_told(tmp_path, board, run_in_process):
    """A detector 0.05 mm further out than the board knows."""
    first, *others = CONFIG.sensor.psds
    psds = (replace(first, radius=first.radius + 0.05), *others)
    other = compile_library(tmp_path, replace(CONFIG.sensor, psds=psds))
    (tmp_path / "board.bin").write_bytes(send(board(other)))
    status, _, errors = run_in_process(
        "acquire", "bench", "--port", "file:board.bin", "--no-record", "--plain", "--compare-board"
    )
    assert status == 1
    assert "another sensor" in errors


def test_after_a_restart_samples_are_not_compared_with_others(board):
    made = board()
    data = send(made, 300)
    made.born, made.born_at = 300, 0.03
    poses = fed(data + send(made, 300, first=300)).board
    assert poses.statuses == poses.apart == 0
    assert 500 < poses.compared <= 600


@pytest.mark.parametrize("channels", [0, 2])
def test_the_exported_frames_are_read(tmp_path, library, channels):
    """Bytes that the C code itself writes."""
    program = tmp_path / "frames.c"
    program.write_text(
        """
        #include <stdio.h>
        #include "facets_frame.h"
        int main(void) {
            uint8_t frame[FACETS_FRAME_SIZE];
            int32_t counts[12] = {1, -2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 2147483647};
            facets_solution solution = {{0}};
            int n;
            for (n = 0; n < 8; n++) solution.state[n] = 0.5 * n;
            solution.power = 0.25; solution.residual = 1.5; solution.status = 3;
            solution.steps = 7; solution.used[0] = 1; solution.used[2] = 1;
            const float channels[2] = {1.25f, -3e30f};
            facets_frame_counts(frame, FACETS_FRAME_ELECTRODES, FACETS_FRAME_OVERRUN, 4000000000u,
                                17, counts);
            facets_frame_channels(frame, channels);
            fwrite(frame, 1, sizeof frame, stdout);
            facets_frame_pose(frame, 4000000000u, 18, &solution, 65000);
            fwrite(frame, 1, sizeof frame, stdout);
            return 0;
        }
        """
    )
    compile_c(library.parent, program, "-I.", "facets_frame.c", f"-DFACETS_CHANNELS={channels}",
              "-o", tmp_path / "f")  # fmt: skip
    data = subprocess.run([tmp_path / "f"], capture_output=True, check=True).stdout
    parser = FixedFrames(channels)
    samples = parser.feed(data)
    assert parser.corrupt == parser.skipped == 0
    assert samples.kind.tolist() == [1, POSE]
    assert samples.seq.tolist() == [4000000000] * 2
    assert [*samples.time, *samples.flags] == [17, 18, 1, 0]
    assert samples.counts[0].tolist() == [1, -2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 2147483647]
    expected = np.array([[1.25, -3e30], [np.nan, np.nan]], np.float32)[:, :channels]
    np.testing.assert_array_equal(samples.channels, expected)
    pose = board_solution(samples.where(samples.kind == POSE))[0]
    assert pose["state"].tolist() == [0.5 * n for n in range(8)]
    numbers = pose[["power", "residual", "status", "used", "steps", "microseconds"]]
    assert numbers.item() == (0.25, 1.5, 3, 5, 7, 65000)


def test_the_exported_heartbeat_is_that_of_the_virtual_board(tmp_path, library, board):
    """Byte by byte, among noise, spoilt and repeated frames; also where the clock wraps."""
    program = tmp_path / "beats.c"
    program.write_text(
        """
        #include <stdio.h>
        #include "facets_frame.h"
        int main(void) {
            facets_heartbeat heartbeat = {{0}, 0, 0, 0, 0};
            unsigned now, byte;
            while (scanf("%u %u", &now, &byte) == 2) {
                facets_heartbeat_feed(&heartbeat, (uint8_t)byte, now);
                putchar('0' + facets_heartbeat_is_alive(&heartbeat, now, 100000));
            }
            return 0;
        }
        """
    )
    compile_c(library.parent, program, "-I.", "facets_frame.c", "-o", tmp_path / "b")
    rng, count, watch = np.random.default_rng(3), 2**32 - 20, board().watch
    now, lines, expected = 2**32 - 1_000_000, [], ""
    for _ in range(300):
        count += int(rng.choice([0, 1, 1, 1]))
        frame = bytearray(heartbeat_frame(count, bool(rng.random() < 0.9)))
        if rng.random() < 0.1:
            frame[rng.integers(12)] ^= 4
        now += int(rng.choice([20_000, 20_000, 150_000]))
        for byte in frame:
            watch.feed(bytes([byte]), 1e-6 * now)
            lines.append(f"{now % 2**32} {byte}")
            expected += str(int(watch.is_alive(1e-6 * now)))
    done = subprocess.run(
        [tmp_path / "b"], input="\n".join(lines), capture_output=True, check=True, text=True
    )
    assert done.stdout == expected
    assert 0.1 < expected.count("1") / len(expected) < 0.9


@pytest.mark.slow
def test_acquire_compares(tmp_path, library, run_in_process):
    words = ("--motion", "wobble", "--rate", "1000", "--firmware", str(library))
    with Program("emulate", "bench", *words, cwd=tmp_path) as bench:
        bench.await_output("running")
        status, output, errors = run_in_process(
            "acquire", "bench", "--port", "bench/board", "--samples", "300", "--plain",
            "--compare-board", "--max-loss", "1",
        )  # fmt: skip
    assert status == 0, errors
    assert "the board solved" in output
