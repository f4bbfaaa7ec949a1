"""How well `facets response` finds known responses: random errors, biases, and modes.

    python -m facets.experiments.studies.frequency_responses [--records 20] [--seed 1]

A body with three known modes is shaken by a known force; its motion gets the white noise that the
shipped `shaker` has, and the responses are compared with the receptance. The modes are identified
by sdypy-EMA from the universal file.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

import facets
from facets.core.motions import Mode, Vibration
from facets.core.rigid_body import MIRROR
from facets.core.units import Floats
from facets.responses.frequency_response import (
    FrequencyResponse,
    OutputChannel,
    estimate_response,
    find_stretches,
)
from facets.responses.signals import noise_deviation
from facets.responses.universal_file import InputChannel, Node, write_universal_file
from facets.simulation.vibration import receptance, shake

CONFIG = facets.load("shaker")
BODY = CONFIG.motions["shaken"]
assert isinstance(BODY, Vibration)
RECORD = replace(BODY, rate=1000.0, samples=120_000)
NOISE = noise_deviation(CONFIG, np.zeros(8), np.ones(3, dtype=bool), MIRROR)
#: Distance of the lines, Hz: 12 to 19 lines in the half-power widths of the modes.
RESOLUTION_HZ = 0.125
#: Lines in the half-power width at which the bias at the peak is measured.
LINES = (2, 3, 4, 6, 8)


def measure(
    motion: Vibration, rng: np.random.Generator, resolution: float, noise: float = 1.0,
    input_noise: float = 0.0,
) -> FrequencyResponse:  # fmt: skip
    """Response of one record.  noise: over that of the sensor.  input_noise: N, of the force."""
    force, moved = shake(motion, rng)
    count = len(force)
    moved = moved + noise * NOISE * rng.standard_normal(moved.shape)
    force = force + input_noise * rng.standard_normal(count)
    stretches = find_stretches(np.arange(count) / motion.rate, np.ones(count, bool), "record")
    return estimate_response(force, moved, stretches, resolution, OutputChannel(noise * NOISE))


def show_coverage(records: int, seed: int) -> None:
    """Share of lines whose receptance lies within the 95 % interval, and near resonances."""
    for drive in ("random", "burst"):
        inside: list[Floats] = []
        near: list[Floats] = []
        for n in range(records):
            motion = replace(RECORD, drive=drive)
            response = measure(motion, np.random.default_rng([seed, n]), RESOLUTION_HZ)
            true = np.abs(receptance(motion, response.frequency))
            apart = np.abs(np.abs(response.h1) - true) / response.uncertainty
            use = response.is_excited[:, None] & (true > 0) & (response.coherence > 0.1)
            peak = np.zeros(len(response.frequency), bool)
            for mode in motion.modes.values():
                width = 2 * mode.damping * mode.frequency
                peak |= np.abs(response.frequency - mode.frequency) < 2 * width
            held = apart < response.coverage_factor
            inside.append(held[use & ~peak[:, None]])
            near.append(held[use & peak[:, None]])
        far, close = (100 * np.concatenate(part).mean() for part in (inside, near))
        print(f"{drive}: {far:.1f} % of the lines, {close:.1f} % within two widths of a peak")


def show_noise_bias(records: int, seed: int) -> None:
    """Mean of H1 and H2 over the receptance, at low signal-to-noise ratios."""
    for output, stimulus in ((1.0, 0.0), (30.0, 0.0), (100.0, 0.0), (1.0, 0.25), (1.0, 0.5)):
        ratios = []
        for n in range(records):
            rng = np.random.default_rng([seed, 100 + n])
            response = measure(RECORD, rng, 0.5, output, stimulus)
            true = receptance(RECORD, response.frequency)[:, 2]
            use = (response.frequency > 10) & (response.frequency < 40)
            biases = [np.mean((h[use, 2] / true[use]).real) for h in (response.h1, response.h2)]
            ratios.append([*biases, response.coherence[use, 2].mean()])
        h1, h2, coherence = np.mean(ratios, axis=0)
        print(f"sensor's noise x {output:g}, {stimulus:g} N of noise on the input: coherence "
              f"{coherence:.3f}, H1 {h1:.3f}, H2 {h2:.3f} of the truth")  # fmt: skip


def show_leakage(records: int, seed: int) -> None:
    """|H1| at a resonance over the truth, by the lines in its half-power width."""
    mode = Mode(150.0, 0.01, (0.0, 0.0, 0.01, 0.0, 0.0, 0.0))
    motion = replace(RECORD, modes={"one": mode})
    for lines in LINES:
        ratios = []
        for n in range(records):
            response = measure(motion, np.random.default_rng([seed, 200 + n]), 3.0 / lines)
            line = int(np.argmin(np.abs(response.frequency - mode.frequency)))
            true = np.abs(receptance(motion, response.frequency[[line]]))[0, 2]
            ratios.append(np.abs(response.h1[line, 2]) / true)
        scatter = np.std(ratios) / np.sqrt(records)
        print(f"{lines} lines in the width: |H1| is {100 * (np.mean(ratios) - 1):+.1f} % off, "
              f"+- {100 * scatter:.1f}")  # fmt: skip


def show_modes(records: int, seed: int) -> None:
    """Frequencies and damping that sdypy-EMA finds in the universal files."""
    from sdypy import EMA

    modes = list(RECORD.modes.values())
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.uff"
        for n in range(records):
            response = measure(RECORD, np.random.default_rng([seed, n]), RESOLUTION_HZ)
            channel, node = InputChannel("force_n"), Node(1, (0.0, 0.0, 0.0))
            write_universal_file(path, [(response, channel)], node, {})
            model = EMA.Model(lower=20, upper=300, pol_order_high=24)
            model.read_uff(str(path))
            with contextlib.redirect_stderr(io.StringIO()):
                model.get_poles(show_progress=False)
            model.select_closest_poles([mode.frequency for mode in modes], f_window=8)
            rows.append([model.nat_freq, model.nat_xi])
    for n, mode in enumerate(modes):
        frequency, damping = np.array(rows)[:, :, n].T
        print(f"{mode.frequency:g} Hz, {100 * mode.damping:g} %: "
              f"{1e3 * (frequency.mean() - mode.frequency):+.1f} mHz, +- "
              f"{1e3 * frequency.std(ddof=1):.1f}; damping "
              f"{100 * (damping.mean() / mode.damping - 1):+.2f} %, +- "
              f"{100 * damping.std(ddof=1) / mode.damping:.2f}")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    for show in (show_coverage, show_noise_bias, show_leakage, show_modes):
        show(arguments.records, arguments.seed)


if __name__ == "__main__":
    main()
