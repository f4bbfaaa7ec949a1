"""Noise with a spectrum that is known, for the tests of its analysis."""

from __future__ import annotations

import numpy as np


def flicker(rng, density, count, rate):
    """1/f noise by its spectrum, from eight times as long a piece, so that it has slow parts."""
    size = 8 * count
    frequency = np.fft.rfftfreq(size, 1 / rate)[1:]
    drawn = rng.standard_normal((2, len(frequency)))
    half = np.sqrt(density / frequency * rate * size / 4) * (drawn[0] + 1j * drawn[1])
    return np.fft.irfft(np.concatenate([[0], half]), size)[:count]
