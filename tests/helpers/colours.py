"""Noise with a known spectrum for the tests of noise analysis."""

from __future__ import annotations

import numpy as np


def flicker(rng, density, count, rate):
    """1/f noise from a series eight times as long, so that it contains slow parts."""
    size = 8 * count
    frequency = np.fft.rfftfreq(size, 1 / rate)[1:]
    drawn = rng.standard_normal((2, len(frequency)))
    half = np.sqrt(density / frequency * rate * size / 4) * (drawn[0] + 1j * drawn[1])
    return np.fft.irfft(np.concatenate([[0], half]), size)[:count]
