"""The exported C beside its poses, which tests of estimation compare: counts, vectors, refusals."""

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sensors import SENSORS

import facets
from facets import BenchLight, Correction, Grid, InputError, firmware
from facets.detectors import correct, counts_to_readings, counts_to_xy_sum, readings_to_counts

COMPILERS = [each for each in ("gcc", "clang") if shutil.which(each)]
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-pedantic"]
STRICT = ["-std=c99", *WARNINGS, "-Werror"]
SINGLE, DOUBLE = "-DFACETS_FLOAT", "-DFACETS_DOUBLE"
GUARDS = ["-g", "-fsanitize=undefined,address", "-fno-sanitize-recover=all"]
HELPERS = Path(__file__).parents[1] / "helpers"
PAPER, BENCH = facets.Sensor(), facets.load("bench").sensor
SINGULAR = facets.load("singular").sensor
ABOUT = firmware.source.Provenance("test", "0" * 8, "facets export-c test")
needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C compiler")
needs_arm = pytest.mark.skipif(
    not (shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm")),
    reason="no cross compiler for Cortex-M, or no QEMU",
)


def with_corrections() -> facets.Sensor:
    """A sensor without symmetry, with electronics, all corrections, and a grid on one detector."""
    rng = np.random.default_rng(5)
    grid = Grid((-6, 0, 7), (-5, -1, 2, 6), *(1e-3 * rng.standard_normal((2, 3, 4))).tolist())
    psds = []
    for k, psd in enumerate(SENSORS["skewed1"].psds):
        y, z = (0.02 * rng.standard_normal((2, 9))).tolist()
        correction = Correction(0.02 * rng.standard_normal(), 1e-4, y, z, grid if k == 1 else None)
        psds.append(replace(psd, correction=correction))
    electronics = facets.Electronics(kind="pincushion", transimpedance=2e4, adc_bits=18)
    return replace(SENSORS["skewed1"], psds=tuple(psds), electronics=electronics)


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def compile_c(folder: Path, arguments: list[str], compiler: str = "") -> None:
    command = [compiler or COMPILERS[0], "-O1", *STRICT, "-I.", *arguments, "-lm"]
    done = run(command, folder)
    assert done.returncode == 0, done.stderr


def written(folder: Path, sensor: facets.Sensor) -> Path:
    for path, text in firmware.export.export(sensor, ABOUT).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The code of the bench."""
    return written(tmp_path_factory.mktemp("bench"), BENCH)


def library(folder: Path, precision: str) -> firmware.FirmwareLibrary:
    name = f"libfacets{precision}.so"
    compile_c(folder, ["facets.c", "-shared", "-fPIC", "-o", name, precision])
    return firmware.FirmwareLibrary(folder / name)


@needs_compiler
@pytest.mark.parametrize("precision", [SINGLE, DOUBLE])
def test_a_beam_that_has_followed_is_known_where_it_is(folder, precision):
    """Millimetres off: a reading then tells x and y to 2 nm, single precision's step being 0.2."""
    rng, code = np.random.default_rng(9), library(folder, precision)
    for place in rng.uniform(-4, 4, (10, 2)):
        start = np.array([*place, 0, 0, 0, 0, *place])
        state = start + np.pad(rng.uniform(-0.05, 0.05, 2), (0, 6))
        reading = facets.add_noise(BENCH, facets.readings(BENCH, state)[None], rng)
        prior = [*place, BENCH.beam.power]
        solution = code.solve(reading, [*start, prior[2]], mean=prior, sigma=np.zeros(3))
        known = facets.solve(BENCH, reading, beam=facets.Prior(place, 0.0), start=start)
        assert solution.status == known.status == 0
        off = np.abs(solution.state - known.state)[0, :6]
        assert (off < (1e-4 if precision == DOUBLE else 0.3) * known.uncertainty[0, :6]).all()


@needs_compiler
def test_a_wrong_sensor_is_found_by_its_vectors(folder, tmp_path):
    """The test program fails where code and vectors are of two sensors."""
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    code = (tmp_path / "facets.c").read_text()
    assert "R(250.0)" in code
    for text, status in ((code, 0), (code.replace("(250.0)", "(250.001)"), 1)):
        (tmp_path / "facets.c").write_text(text)
        compile_c(tmp_path, ["facets.c", "facets_test.c", "-o", "t"])
        assert run([f"{tmp_path}/t"], tmp_path).returncode == status


@needs_compiler
def test_counts_become_the_same_readings(tmp_path):
    """Those of electrodes, and sums and differences."""
    sensor, rng = with_corrections(), np.random.default_rng(3)
    electronics, code = sensor.electronics, library(written(tmp_path, sensor), DOUBLE)
    states = rng.uniform(-1, 1, (200, 8)) * [0.1, 0.1, 2, 5e-3, 5e-3, 5e-3, 0.1, 0.1]
    of_electrodes = readings_to_counts(sensor, electronics, facets.readings(sensor, states), rng)
    of_electrodes[::10, 3] = 2**electronics.adc_bits
    dark = rng.uniform(0, 3, 12)
    for xy_sum in (False, True):
        counts = counts_to_xy_sum(electronics, of_electrodes) if xy_sum else of_electrodes
        known = correct(sensor, counts_to_readings(sensor, electronics, counts, xy_sum, dark)[0])
        values = code.readings_of_counts(counts, dark, xy_sum)
        whole = np.isfinite(known).all(axis=1)
        assert whole.sum() > 50
        np.testing.assert_allclose(values[whole], known[whole], rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(np.isnan(values), np.isnan(known))


@needs_compiler
def test_spots_beside_the_usable_area_are_left_out(tmp_path):
    psds = (PAPER.psds[0], PAPER.psds[1].limit(0, -9.0, 0.1).limit(1, -0.2, 9.0), PAPER.psds[2])
    sensor, rng = replace(PAPER, psds=psds), np.random.default_rng(2)
    code = library(written(tmp_path, sensor), DOUBLE)
    states = rng.uniform(-1, 1, (60, 8)) * [0.1, 0.1, 1, 1e-3, 1e-3, 1e-3, 0.1, 0.1]
    values = facets.readings(sensor, states)
    known = facets.solve(sensor, values)
    np.testing.assert_array_equal(code.solve(values).status, known.status)
    assert 10 < known.converged.sum() < 50


def under_real_light() -> facets.Sensor:
    """The bench under all effects, its detectors read at one time."""
    sensor = facets.load("bench-light").sensor
    return replace(sensor, light=replace(sensor.light, delays=(0.0, 0.0, 0.0)))


@needs_compiler
@pytest.mark.slow
def test_poses_under_real_light(tmp_path):
    """The package steps with derivatives that leave small terms out, C with all of them: exact
    readings give one pose, noisy ones poses that are a small part of their uncertainty apart."""
    sensor, rng = under_real_light(), np.random.default_rng(1)
    code = library(written(tmp_path, sensor), DOUBLE)
    states = rng.uniform(-1, 1, (200, 8)) * [0.1, 0.1, 1, 5e-3, 5e-3, 5e-3, 0.1, 0.1]
    exact = facets.readings(sensor, states)
    for values, apart in ((exact, 1e-6), (facets.add_noise(sensor, exact, rng), 0.05)):
        found, known = code.solve(values), facets.solve(sensor, values)
        np.testing.assert_array_equal(found.status, known.status)
        assert (known.status == 0).mean() > 0.9
        off = np.abs(found.state - known.state)[known.converged]
        assert (off < apart * known.uncertainty[known.converged]).all()


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor", [under_real_light(), replace(PAPER, apertures=facets.Apertures(rim=4.0))]
)
def test_real_light_is_refused_in_single_precision(sensor, tmp_path):
    written(tmp_path, sensor)
    compiling = [COMPILERS[0], "-c", "facets.c", "-o", "facets.o"]
    assert "double precision only" in run([*compiling, SINGLE], tmp_path).stderr
    assert run([*compiling, DOUBLE], tmp_path).returncode == 0


@needs_compiler
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("precision", [SINGLE, DOUBLE])
@pytest.mark.slow
def test_nothing_undefined_whatever_comes(folder, compiler, precision):
    """Under the sanitizers of addresses and of undefined behaviour, with all kinds of numbers."""
    (folder / "empty.c").write_text("int main(void) { return 0; }")
    if run([compiler, *GUARDS, "empty.c", "-o", "empty"], folder).returncode:
        pytest.skip(f"{compiler} has no sanitizers here: their library is a package of its own")
    sources = ["facets.c", "facets_frame.c", str(HELPERS / "firmware_fuzz.c")]
    compile_c(folder, [*sources, *GUARDS, precision, "-o", "fuzz"], compiler)
    done = run(["./fuzz"], folder)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.skipif(not shutil.which("g++"), reason="no C++ compiler")
def test_the_sketch_is_sound(folder):
    """Its syntax and types, with the Arduino environment as far as it asks for it."""
    command = ["g++", "-std=c++14", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I."]
    stub = ["-include", str(HELPERS / "arduino_stub.h"), "-x", "c++", "teensy41/teensy41.ino"]
    done = run([*command, *stub], folder)
    assert done.returncode == 0, done.stderr


@needs_compiler
def test_the_caller_in_python_runs(folder):
    """With nothing of facets but the folder that was written."""
    library(folder, DOUBLE)
    caller = [sys.executable, "-I", "callers/facets_ctypes.py", f"libfacets{DOUBLE}.so"]
    done = run(caller, folder)
    assert "status: converged" in done.stdout, done.stderr
    assert "tz: 0.1 mm; yaw: 1.0 mrad" in done.stdout


@needs_arm
@pytest.mark.parametrize(
    "core",
    [
        ["-mcpu=cortex-m7", "-mfpu=fpv5-d16"],
        ["-mcpu=cortex-m7", "-mfpu=fpv5-d16", SINGLE],
        ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", SINGLE],
    ],
)
@pytest.mark.slow
def test_a_controller_finds_the_same_poses(folder, core):
    """In QEMU; the number of instructions, which is no time, is printed with `pytest -s`."""
    arm = HELPERS / "cortex_m7"
    for program in (folder / "facets_test.c", arm / "count.c"):
        done = run(
            ["arm-none-eabi-gcc", "-O2", "-std=c99", "-mthumb", "-mfloat-abi=hard", *core, "-I.",
             "-T", str(arm / "mps2.ld"), "--specs=rdimon.specs", "facets.c", str(program),
             str(arm / "start.c"), "-o", "m.elf", "-lm"], folder,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        done = run(
            ["qemu-system-arm", "-M", "mps2-an500", "-nographic", "-semihosting",
             "-icount", "shift=0", "-kernel", "m.elf"], folder,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout
        print(core, done.stdout)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"light": BenchLight(delays=(0.0, 1e-5, 0.0))}, "delays"),
        ({"electronics": facets.Electronics(kind="tetra-lateral")}, "tetra-lateral"),
        ({"psds": tuple(replace(psd, height=20.0) for psd in PAPER.psds)}, "misses"),
        ({"facets": SINGULAR.facets, "psds": SINGULAR.psds}, "two"),
    ],
)
def test_what_the_c_would_not_give_is_refused(change, word):
    with pytest.raises(InputError, match=word):
        firmware.export.export(replace(PAPER, **change), ABOUT)
