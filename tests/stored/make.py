"""Make the stored files of the current version of facets: `python tests/stored/make.py`.

Run it once for each release; `test_stored.py` reads the files of all versions ever after. It writes
the folder of the version beside this file, and refuses to change one that exists. All numbers are
the same at each run but for the times of making. `expected.json` says what must be read; it comes
from the poses that the readings are simulated from, and not from the code that reads.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import sys
from pathlib import Path

import numpy as np
from facets.cli import main
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

import facets
from facets.core import READING_COLUMNS, STATE_COLUMNS, STATE_UNITS
from facets.detectors import add_noise, counts_to_xy_sum, readings_to_counts
from facets.files import run_record, write_table
from facets.live import (
    ELECTRODES,
    POSE,
    SOLVED,
    XY_SUM,
    Block,
    Pipeline,
    RawSamples,
    Recording,
    encode,
)
from facets.tracking import Encoder

COUNT, BLOCKS = 6, 3
POINT = np.array([10.0, -20.0, 30.0])
CONFIG = f"""
extends: bench
sensor: {{electronics: {{adc_bits: 24, transimpedance_kohm: 50}}}}
object: {{point_mm: {POINT.tolist()}}}
acquire: {{channels: [{{name: force, unit: N, scale: 0.5}}, {{name: temperature, unit: degC}}]}}
calibrate:
  reference: {{tx_um: 0.01, ty_um: 0.01, tz_um: 0.01,
               roll_urad: 0.05, pitch_urad: 0.05, yaw_urad: 0.05}}
"""
#: The rig that the calibration has to find.
RIG = "extends: config.yaml\nsensor: {psd: {a: {radius_mm: 250.05}, b: {height_mm: 0.02}}}\n"


def command(*words: str) -> None:
    sys.argv = ["facets", *words]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise


def make_states(count: int) -> np.ndarray:
    """Poses in mm and rad within half of the range; the first is zero."""
    rng = np.random.default_rng(1)
    states = rng.uniform(-1, 1, (count, 8)) * [0.5, 0.5, 0.5, 2e-3, 2e-3, 2e-3, 0, 0]
    states[0] = 0.0
    return states


def object_poses(states: np.ndarray) -> np.ndarray:
    """The poses of the point of interest; mm and mrad."""
    poses = states[:, :6].copy()
    poses[:, :3] += Rotation.from_euler("xyz", states[:, 3:6]).apply(POINT)
    return poses / STATE_UNITS[:6]


def make_tables(states: np.ndarray) -> None:
    config = facets.load("config.yaml")
    readings = facets.readings(config.sensor, states[:COUNT])
    for ending in ("csv", "csv.gz", "parquet", "h5"):
        columns = dict(zip(READING_COLUMNS, readings.T, strict=True))
        write_table(Path(f"readings.{ending}"), columns, {"seed": "1"})
        command(
            "solve", "config.yaml", f"readings.{ending}", "--zero", "row:1", "-o", f"poses.{ending}"
        )
    rig = facets.load("rig.yaml").sensor
    noisy = add_noise(rig, facets.readings(rig, states), np.random.default_rng(2))
    reference = zip(STATE_COLUMNS[:6], (states / STATE_UNITS).T, strict=False)
    columns = dict(zip(READING_COLUMNS, noisy.T, strict=True))
    columns |= {f"ref_{name}": values for name, values in reference}
    write_table(Path("measured.csv"), columns, {})
    command("calibrate", "config.yaml", "measured.csv", "-o", "calibrated.yaml")
    for name in ("measured.csv", "calibrated.png", "calibrated-found.csv"):
        Path(name).unlink()


def make_samples(states: np.ndarray, channels: int) -> dict[str, RawSamples]:
    """What a board sends of the poses, by the content of its frames."""
    config = facets.load("config.yaml")
    readings = facets.readings(config.sensor, states)
    counts = readings_to_counts(config.sensor, config.electronics, readings)
    number = np.arange(len(states), dtype=np.uint32)
    values = np.stack([0.25 * number, 20.5 + number], axis=1).astype(np.float32)
    none = np.zeros(len(states), np.uint8)
    solved = np.zeros(len(states), SOLVED)
    solved["state"], solved["used"] = states, 7
    contents = {
        "electrodes": (ELECTRODES, counts),
        "xy-sum": (XY_SUM, counts_to_xy_sum(config.electronics, counts)),
        "poses": (POSE, solved.view("<i4").reshape(-1, 12)),
    }
    return {
        name: RawSamples(none + np.uint8(kind), none, number, 100 * number, numbers,
                      values[:, :channels] if kind != POSE else np.nan * values[:, :channels])
        for name, (kind, numbers) in contents.items()
    }  # fmt: skip


def make_streams(states: np.ndarray) -> None:
    Path("streams").mkdir()
    for form in ("frames", "cobs", "text"):
        for channels in (0, 2):
            for content, samples in make_samples(states, channels).items():
                if (form, content) != ("text", "poses"):
                    path = Path("streams", f"{form}-{content}-{channels}.bin")
                    path.write_bytes(encode(form, samples))


def make_recording(states: np.ndarray) -> None:
    config = facets.load("config.yaml")
    meta = run_record(config, None, 0.0, {})
    samples = make_samples(states, 2)["electrodes"]
    with Recording(Path("recording"), meta, config.resolved) as recording:
        pipeline = Pipeline(config)
        recording.add_event("connected")
        for n, numbers in enumerate(np.split(np.arange(COUNT), BLOCKS)):
            arrival = 100.0 + 0.01 * n
            encoder = Encoder(arrival, np.zeros(2), np.zeros(2))
            block = Block(encode("frames", samples.where(numbers)), arrival, encoder)
            recording.add_block(block)
            recording.add_poses(pipeline.feed(block.data, block.arrival, block.encoder))
    command("replay", "recording", "-o", "poses.mcap")


def make_expected(states: np.ndarray) -> dict:
    samples = make_samples(states, 2)
    with Path("calibrated-covariance.csv").open() as file:
        names, *rows = [line.strip().split(",") for line in file if not line.startswith("#")]
    proof = json.loads(Path("certificate.json").read_text())
    files = [path for path in sorted(Path().rglob("*")) if path.is_file()]
    return {
        "poses": (states / STATE_UNITS).tolist(),
        "object": object_poses(states).tolist(),
        "displacement": (object_poses(states) - [*POINT, 0, 0, 0]).tolist(),
        "counts": {name: samples[name].counts.tolist() for name in ("electrodes", "xy-sum")},
        "channels": samples["electrodes"].channels.tolist(),
        "parameters": names,
        "uncertainties": [float(row[n]) ** 0.5 for n, row in enumerate(rows)],
        "margin": proof["margin"],
        "sha256": {p.as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files},
    }


def make(folder: Path) -> None:
    folder.mkdir()
    os.chdir(folder)
    Path("config.yaml").write_text(CONFIG)
    resolved = facets.load("config.yaml").resolved
    with Path("config.yaml").open("w") as file:
        YAML(typ="safe").dump(resolved, file)
    Path("rig.yaml").write_text(RIG)
    states = make_states(60)
    make_tables(states)
    make_streams(states[:COUNT])
    make_recording(states[:COUNT])
    command("jacobian", "config.yaml", "--states", "1000", "--box", "tx_mm=0.01", "--certify",
            "--no-search-worst", "-d", "proof")  # fmt: skip
    Path("proof/certificate.json").rename("certificate.json")
    shutil.rmtree("proof")
    Path("rig.yaml").unlink()
    Path("expected.json").write_text(json.dumps(make_expected(states[:COUNT])))


if __name__ == "__main__":
    make(Path(__file__).parent / facets.__version__.rpartition(".")[0])
