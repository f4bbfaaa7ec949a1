"""`facets bench`: that its contenders compute the same, and that its table says so."""

import json
import time

import pytest
from commands import command

from facets.bench import Contender, alternate

#: Ten times the last bit of a float, relative; and how far the sub-beams travel.
LAST_DIGIT, FLIGHT_MM = 2.2e-15, 250.0


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    done = command("bench", "--quick", "-d", "out", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "out"


def read(folder, name):
    import pandas as pd

    return pd.read_csv(folder / f"{name}.csv", comment="#")


@pytest.mark.slow
def test_errors_are_those_of_rounding(results):
    """No times: machines are noisy. 1e-12 mm is 300 mm's rounding times a dozen steps."""
    forward = read(results, "forward").set_index("way")
    ours = forward[forward.index.str.startswith("facets")].dropna()
    assert len(ours) == 3
    assert (ours.place_error_mm < LAST_DIGIT * FLIGHT_MM).all()
    assert (ours.power_error < LAST_DIGIT).all()
    rivals = forward.place_error_mm
    assert rivals["Gauss-Legendre 12 (NumPy batch)"] < 1e-6
    assert rivals["dblquad (as the paper)"] < 1e-10
    inverse = read(results, "inverse").set_index("way")
    ours = inverse[inverse.index.str.startswith("facets")]
    assert len(ours) == 5
    assert (ours.length_error_mm < 1e-10).all()
    assert (ours.angle_error_rad < 1e-12).all()
    stability = read(results, "stability")
    assert (stability.place_error_mm < 1e-12).all()
    assert (stability.power_error < 1e-13).all()


@pytest.mark.slow
def test_everything_is_written_with_the_machine(results):
    names = {file.name for file in results.iterdir()}
    assert names == {
        "forward.csv", "inverse.csv", "calls.csv", "light.csv", "starts.csv", "live.csv",
        "apertures.csv", "stability.csv", "machine.json", "stability.png",
    }  # fmt: skip
    about = json.loads((results / "machine.json").read_text())["about"]
    assert {"processor", "cores", "numpy", "seed", "command"} <= set(about)


@pytest.mark.slow
def test_every_call_has_a_stored_ratio(results):
    calls = read(results, "calls")
    assert calls.stored.notna().all()
    assert calls.ratio.iloc[0] == calls.stored.iloc[0] == 1


@pytest.mark.slow
def test_a_bound_spares_what_is_not_cut(results):
    cuts = read(results, "apertures").set_index("cut").poses_cut
    assert cuts["nothing cut"] == cuts["rim at 5 mm"] == 0
    assert 0 < cuts["detectors"] < 1
    assert cuts["beam at 1/e^2"] == 1


def test_slow_contenders_run_once_and_fast_ones_every_round(monkeypatch):
    clock, calls = [0.0], {"slow": 0, "fast": 0}
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])

    def contender(name, seconds):
        def work(_):
            calls[name] += 1
            clock[0] += seconds

        return Contender(name, work, 1)

    timings = alternate([contender("slow", 2.1), contender("fast", 0.5)], [0], 3)
    assert calls == {"slow": 1, "fast": 3}
    assert timings == pytest.approx([2.1, 0.5])
