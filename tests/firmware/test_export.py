"""The exported C against facets itself: poses, statuses, counts, and what it refuses."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from facets.experiments import sensors as sensors_
from facets.experiments import solver_stress

import facets
from facets import BenchLight, Correction, Grid, InputError, Status
from facets.detectors import correct, counts_to_readings, counts_to_xy_sum, readings_to_counts
from facets.firmware import FirmwareLibrary
from facets.firmware import export as export_module
from facets.firmware.export import export
from facets.firmware.source import Provenance
from facets.firmware.vectors import sample_states

from ..helpers.pages import ROOT

COMPILERS = [each for each in ("gcc", "clang") if shutil.which(each)]
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-pedantic"]
STRICT = ["-std=c99", *WARNINGS, "-Werror"]
SINGLE, DOUBLE = "-DFACETS_FLOAT", "-DFACETS_DOUBLE"
GUARDS = ["-g", "-fsanitize=undefined,address", "-fno-sanitize-recover=all"]
HELPERS = ROOT / "tests" / "helpers"
needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C compiler")


def with_corrections() -> facets.Sensor:
    """A sensor without symmetry, with electronics, all corrections, and a grid on one detector."""
    sensor = sensors_.SENSORS["skewed1"]
    rng = np.random.default_rng(5)
    grid = Grid(
        y=(-6.0, 0.0, 7.0),
        z=(-5.0, -1.0, 2.0, 6.0),
        add_y=tuple(map(tuple, 1e-3 * rng.standard_normal((3, 4)))),
        add_z=tuple(map(tuple, 1e-3 * rng.standard_normal((3, 4)))),
    )
    psds = [
        replace(
            psd,
            correction=Correction(
                power=0.02 * rng.standard_normal(),
                dark=1e-4,
                y=tuple(0.02 * rng.standard_normal(9)),
                z=tuple(0.02 * rng.standard_normal(9)),
                grid=grid if k == 1 else None,
            ),
        )
        for k, psd in enumerate(sensor.psds)
    ]
    electronics = facets.Electronics(kind="pincushion", transimpedance=2e4, adc_bits=18)
    return replace(sensor, psds=tuple(psds), electronics=electronics)


def written(folder: Path, sensor: facets.Sensor) -> Path:
    for path, text in export(sensor, Provenance("test", "0" * 8, "facets export-c test")).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    return folder


def library(folder: Path, precision: str) -> FirmwareLibrary:
    name = f"lib{precision[2:].lower()}.so"
    if not (folder / name).exists():
        compile_c(folder, ["facets.c", "-shared", "-fPIC", "-o", name, precision])
    return FirmwareLibrary(folder / name)


def compile_c(folder: Path, arguments: list[str], compiler: str = "") -> None:
    command = [compiler or COMPILERS[0], "-O1", *STRICT, "-I.", *arguments, "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def has_sanitizers(compiler: str) -> bool:
    """Whether a program can be linked with them: their library is a package of its own."""
    command = [compiler, *GUARDS, "-x", "c", "-", "-o", "/dev/null"]
    program = "int main(void) { return 0; }"
    done = subprocess.run(command, input=program, text=True, capture_output=True, check=False)
    return done.returncode == 0


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    sensors = {
        "paper": facets.Sensor(),
        "bench": facets.load("bench").sensor,
        "corrected": with_corrections(),
    }
    return {name: written(tmp_path_factory.mktemp(name), each) for name, each in sensors.items()}


def sensor_of(name: str) -> facets.Sensor:
    return with_corrections() if name == "corrected" else facets.load(name).sensor


@needs_compiler
@pytest.mark.parametrize("name", ["paper", "bench", "corrected"])
@pytest.mark.slow
def test_poses_are_those_of_facets(folders: dict[str, Path], name: str) -> None:
    """Double precision to rounding; single within a tenth of the noise, in covariance to 3 %."""
    sensor, rng = sensor_of(name), np.random.default_rng(2)
    exact = facets.readings(sensor, sample_states(sensor, 400, rng))
    readings = np.concatenate([exact, facets.add_noise(sensor, exact, rng)])
    known = facets.solve(sensor, readings)
    sigma = known.uncertainty
    allowed = np.array([1e-10] * 3 + [1e-12] * 3 + [1e-10] * 2)
    for precision in (DOUBLE, SINGLE):
        found = library(folders[name], precision).solve(readings)
        off = np.abs(found.state - known.state)
        assert (found.status == known.status).all()
        assert (found.used == known.used).all()
        ok = known.ok
        assert ok.mean() > 0.8  # noise takes some past the converters' end
        assert (off[ok] <= (allowed if precision == DOUBLE else 0.1 * sigma[ok])).all()
        spread = np.sqrt(np.einsum("nii->ni", found.covariance))[ok]
        assert np.allclose(spread, sigma[ok], rtol=1e-8 if precision == DOUBLE else 0.03)


@needs_compiler
@pytest.mark.parametrize("precision", [SINGLE, DOUBLE])
def test_a_beam_that_has_followed_is_known_where_it_is(
    folders: dict[str, Path], precision: str
) -> None:
    """Millimetres off: a reading then tells x and y to 2 nm, single precision's step being 0.2."""
    sensor, rng = sensor_of("bench"), np.random.default_rng(9)
    for place in rng.uniform(-4, 4, (25, 2)):
        state = np.zeros(8)
        state[:2] = state[6:] = place
        state[:2] += rng.uniform(-0.05, 0.05, 2)
        reading = facets.add_noise(sensor, facets.readings(sensor, state)[None], rng)
        start = np.append(state, sensor.beam.power)
        start[:2] = place
        found = library(folders["bench"], precision).solve(reading, "known", start)
        known = facets.solve(sensor, reading, beam=facets.Prior(state[6:], 0.0), start=start[:8])
        assert found.status == known.status == 0
        off = np.abs(found.state - known.state)[0, :6]
        assert (off < (1e-4 if precision == DOUBLE else 0.3) * known.uncertainty[0, :6]).all()


@needs_compiler
@pytest.mark.parametrize("precision", [SINGLE, DOUBLE])
@pytest.mark.parametrize(
    "sigmas", [(0.02, 0.02, 0.0), (np.inf, np.inf, np.inf), (0.02, 0.01, 3e-4)]
)
def test_what_is_known_before_weighs_as_in_facets(
    folders: dict[str, Path], precision: str, sigmas: tuple[float, float, float]
) -> None:
    """Priors of the beam's place and power, and an unknown power."""
    sensor, rng = sensor_of("bench"), np.random.default_rng(11)
    exact = facets.readings(sensor, sample_states(sensor, 50, rng))
    readings = facets.add_noise(sensor, exact, rng)
    means = (0.01, -0.02, 1.001 * sensor.beam.power)
    known = facets.solve(
        sensor,
        readings,
        beam=facets.Prior(means[:2], sigmas[:2]),
        power=facets.Prior(means[2], sigmas[2]),
    )
    found = library(folders["bench"], precision).solve(readings, means=means, sigmas=sigmas)
    assert (found.status == known.status).all()
    ok = known.ok
    allowed = (1e-4 if precision == DOUBLE else 0.1) * known.uncertainty[ok]
    assert (np.abs(found.state - known.state)[ok] <= allowed).all()
    spread = np.sqrt(np.einsum("nii->ni", found.covariance))[ok]
    rtol = 1e-6 if precision == DOUBLE else 0.05
    assert np.allclose(spread, known.uncertainty[ok], rtol=rtol)
    assert np.allclose(found.power[ok], known.power[ok], rtol=1e-9 if precision == DOUBLE else 1e-5)


@needs_compiler
@pytest.mark.parametrize("precision", [SINGLE, DOUBLE])
def test_a_pose_that_nothing_checks_is_given_on_request_only(
    folders: dict[str, Path], precision: str
) -> None:
    """Of two detectors with the beam known, and of three for nine unknowns."""
    sensor, rng = facets.Sensor(), np.random.default_rng(5)
    states = sample_states(sensor, 40, rng)
    states[:, 6:] = 0
    two = facets.add_noise(sensor, facets.readings(sensor, states), rng)
    whole = two.copy()
    two[np.arange(40), rng.integers(0, 9, 40)] = np.nan
    code = library(folders["paper"], precision)
    known, unknown = {"beam": "known"}, {"sigmas": (np.inf, np.inf, np.inf)}
    for rows, way, same in ((two, known, known), (whole, unknown, {"power": "unknown"})):
        found = code.solve(rows, **way)  # type: ignore[arg-type]
        assert (found.status == Status.UNCHECKED).all()
        assert np.isnan(found.state).all()
        asked = code.solve(rows, accept_unchecked=True, **way)  # type: ignore[arg-type]
        expected = facets.solve(sensor, rows, accept_unchecked=True, **same)  # type: ignore[arg-type]
        assert (asked.status == expected.status).all()
        assert expected.ok.sum() > 30
        off = np.abs(asked.state - expected.state)[expected.ok] / 0.1
        assert (off <= np.maximum(expected.uncertainty[expected.ok], 1e-9)).all()


@needs_compiler
@pytest.mark.parametrize("case", solver_stress.CASES, ids=lambda c: c.name)
def test_statuses_are_those_of_facets(folders: dict[str, Path], case) -> None:  # type: ignore[no-untyped-def]
    """Far, noisy and spoilt readings, and those that cannot be solved: none converges wrongly."""
    sensor, rng = facets.Sensor(), np.random.default_rng(7)
    truth = solver_stress.states(case, 800, rng)
    readings, start = facets.readings(sensor, truth), solver_stress.starts(case, truth, rng)
    if case.spoil:
        readings = case.spoil(sensor, readings, rng)
    readings[::20, 4] = np.nan
    readings[1::20, 2::3] = 0
    readings[2::20, 0] = 50
    known = facets.solve(sensor, readings, start=start)
    begin = None
    if not isinstance(start, str):
        begin = np.column_stack([start, np.full(len(start), sensor.beam.power)])
    found = library(folders["paper"], DOUBLE).solve(readings, start=begin)
    assert (found.status == known.status).all()
    off = np.abs(found.state - known.state)[known.ok] / known.uncertainty[known.ok]
    assert (off < 1e-3).all()


@needs_compiler
@pytest.mark.slow
def test_a_wrong_sensor_is_found_by_its_vectors(folders: dict[str, Path], tmp_path: Path) -> None:
    """The test program fails where code and vectors are of two sensors."""
    shutil.copytree(folders["bench"], tmp_path, dirs_exist_ok=True)
    run = [f"{tmp_path}/t"]
    compile_c(tmp_path, ["facets.c", "facets_test.c", "-o", "t"])
    assert subprocess.run(run, capture_output=True, check=False).returncode == 0
    code = (tmp_path / "facets.c").read_text()
    assert "R(250.0)" in code
    moved = code.replace("(250.0)", "(250.001)")
    (tmp_path / "facets.c").write_text(moved)
    compile_c(tmp_path, ["facets.c", "facets_test.c", "-o", "t"])
    assert subprocess.run(run, capture_output=True, check=False).returncode == 1


@needs_compiler
@pytest.mark.parametrize("kind", ["electrodes", "xy-sum"])
def test_counts_become_the_same_readings(folders: dict[str, Path], kind: str) -> None:
    sensor, rng = with_corrections(), np.random.default_rng(3)
    electronics = sensor.electronics
    assert electronics is not None
    exact = facets.readings(sensor, sample_states(sensor, 200, rng))
    counts = readings_to_counts(sensor, electronics, exact, rng)
    counts[::10, 3] = 2**electronics.adc_bits
    if kind == "xy-sum":
        counts = counts_to_xy_sum(electronics, counts)
    dark = rng.uniform(0, 3, 12)
    raw, _ = counts_to_readings(sensor, electronics, counts, kind == "xy-sum", dark)
    known = correct(sensor, raw)
    found = library(folders["corrected"], DOUBLE).readings_of_counts(counts, dark, kind == "xy-sum")
    whole = np.isfinite(known).all(axis=1)
    assert whole.sum() > 50
    assert np.allclose(found[whole], known[whole], rtol=1e-12, atol=1e-12)
    assert (np.isnan(found) == np.isnan(known)).all()


@needs_compiler
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("precision", [SINGLE, DOUBLE])
@pytest.mark.slow
def test_nothing_undefined_whatever_comes(
    folders: dict[str, Path], compiler: str, precision: str
) -> None:
    """Under the sanitizers of addresses and of undefined behaviour, with all kinds of numbers."""
    if not has_sanitizers(compiler):
        pytest.skip(f"{compiler} has no sanitizers here")
    name = f"fuzz-{compiler}-{precision}"
    sources = ["facets.c", "facets_frame.c", str(HELPERS / "firmware_fuzz.c")]
    compile_c(folders["bench"], [*sources, *GUARDS, precision, "-o", name], compiler)
    done = subprocess.run(
        [f"./{name}"], cwd=folders["bench"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.skipif(not shutil.which("g++"), reason="no C++ compiler")
def test_the_sketch_is_sound(folders: dict[str, Path]) -> None:
    """Its syntax and types, with the Arduino environment as far as it asks for it."""
    command = ["g++", "-std=c++14", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I."]
    stub = ["-include", str(HELPERS / "arduino_stub.h"), "-x", "c++", "teensy41/teensy41.ino"]
    done = subprocess.run(
        [*command, *stub], cwd=folders["bench"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@needs_compiler
def test_the_caller_in_python_runs(folders: dict[str, Path]) -> None:
    """With nothing of facets but the folder that was written."""
    library(folders["paper"], DOUBLE)
    done = subprocess.run(
        [sys.executable, "-I", "callers/facets_ctypes.py", "libfacets_double.so"],
        cwd=folders["paper"], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "status: converged" in done.stdout, done.stderr
    assert "tz: 0.1 mm; yaw: 1.0 mrad" in done.stdout


needs_arm = pytest.mark.skipif(
    not (shutil.which("arm-none-eabi-gcc") and shutil.which("qemu-system-arm")),
    reason="no cross compiler for Cortex-M, or no QEMU",
)


@needs_arm
@pytest.mark.parametrize(
    "core",
    [
        ["-mcpu=cortex-m7", "-mfpu=fpv5-d16"],
        ["-mcpu=cortex-m7", "-mfpu=fpv5-d16", SINGLE],
        ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", SINGLE],
    ],
    ids=["M7 double", "M7 single", "M4 single"],
)
@pytest.mark.slow
def test_a_controller_finds_the_same_poses(folders: dict[str, Path], core: list[str]) -> None:
    """In QEMU; the number of instructions, which is no time, is printed with `pytest -s`."""
    folder, arm = folders["bench"], HELPERS / "cortex_m7"
    for program in (folder / "facets_test.c", arm / "count.c"):
        done = subprocess.run(
            ["arm-none-eabi-gcc", "-O2", "-std=c99", "-mthumb", "-mfloat-abi=hard", *core, "-I.",
             "-T", str(arm / "mps2.ld"), "--specs=rdimon.specs", "facets.c", str(program),
             str(arm / "start.c"), "-o", "m.elf", "-lm"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        done = subprocess.run(
            ["qemu-system-arm", "-M", "mps2-an500", "-nographic", "-semihosting",
             "-icount", "shift=0", "-kernel", "m.elf"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout
        print(core, done.stdout)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"apertures": facets.Apertures(detectors=True)}, "apertures"),
        ({"light": BenchLight(wavelength=6.3e-4)}, "light"),
        ({"light": BenchLight(delays=(0.0, 1e-5, 0.0))}, "delays"),
        ({"electronics": facets.Electronics(kind="tetra-lateral")}, "tetra-lateral"),
        ({"psds": tuple(replace(psd, height=20.0) for psd in facets.Sensor().psds)}, "misses"),
        (
            {
                "facets": tuple(
                    replace(facet, inclination=inclination)
                    for facet, inclination in zip(
                        facets.Sensor().facets, (0.1, 1.3, 1.3), strict=True
                    )
                )
            },
            "opening",
        ),
        (
            {name: getattr(facets.load("singular").sensor, name) for name in ("facets", "psds")},
            "two",
        ),
    ],
)
def test_what_the_c_would_not_give_is_refused(change: dict[str, object], word: str) -> None:
    sensor = replace(facets.Sensor(), **change)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=word):
        export(sensor, Provenance("test", "0", "test"))


def test_every_file_of_the_package_is_written_or_part_of_one_that_is() -> None:
    """They are named one by one; Python's compiled files beside them are none of them."""
    folder = Path(export_module.__file__).parent
    held = {
        path.relative_to(folder / "c").as_posix()
        for path in (folder / "c").rglob("*")
        if path.is_file() and path.parent.name != "__pycache__"
    }
    parts = re.findall(r'template\("([^"]+)"\)', (folder / "source.py").read_text("utf-8"))
    assert held == {*export_module.FILES, *parts}
