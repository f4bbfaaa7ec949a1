"""The vibration of a body on springs: the force of its shaker, and the resulting displacement.

Each mode r has a natural frequency f_r, a damping ratio d_r and a static compliance c_r (for each
axis of the pose). The receptance, displacement per force at the frequency f, is

    H(f) = sum over r of c_r / (1 - (f / f_r)^2 + 2 i d_r f / f_r).

The force is periodic, so that its discrete Fourier transform describes it completely. The
displacement has this transform times H. At the samples this is the exact steady state of the
continuous body.
"""

from __future__ import annotations

from math import isfinite

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.motions import Vibration
from ..core.units import Floats

#: Default upper end of the force's band, as a fraction of the rate.
BAND_FRACTION = 0.4
#: Length of the slopes at both ends of a burst and of a sweep, as a fraction of the period.
TAPER_FRACTION = 0.02


def receptance(motion: Vibration, frequency: Floats) -> NDArray[np.complex128]:
    """Displacement per force (m, 6), mm/N and rad/N, at frequencies (m,), Hz."""
    response = np.zeros((len(frequency), 6), np.complex128)
    for mode in motion.modes.values():
        ratio = np.asarray(frequency) / mode.frequency
        factor = 1 / (1 - ratio**2 + 2j * mode.damping * ratio)
        response += factor[:, None] * np.array(mode.compliance)
    return response


def shake(motion: Vibration, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """One period of the force (n,), N, and of the displacement (n, 6) of the pose, mm and rad."""
    count = motion.samples
    frequency: Floats = np.fft.rfftfreq(count, 1 / motion.rate).astype(np.float64)
    high = motion.high if isfinite(motion.high) else BAND_FRACTION * motion.rate
    if not ((frequency >= motion.low) & (frequency <= high) & (frequency > 0)).any():
        raise InputError(
            f"a vibration from from_hz: {motion.low:g} to to_hz: {high:g} with {count} samples at "
            f"rate_hz: {motion.rate:g} has no frequency; allowed: from_hz below to_hz and below "
            f"half of rate_hz, and {motion.rate / count:g} Hz or more between them"
        )
    if motion.drive == "sweep":
        time = np.arange(count) / count
        cycles = (motion.low + (high - motion.low) * time / 2) * time * count / motion.rate
        force = np.sin(2 * np.pi * cycles)
    else:
        force = rng.standard_normal(count)
    if motion.drive != "random":
        length = count if motion.drive == "sweep" else count // 2
        force *= _taper(count, length)
    spectrum = np.fft.rfft(force)
    spectrum[(frequency < motion.low) | (frequency > high)] = 0.0
    spectrum[0] = 0.0
    force = np.fft.irfft(spectrum, count)
    scale = motion.force / np.sqrt(np.mean(force**2))
    moved = np.fft.irfft(scale * spectrum[:, None] * receptance(motion, frequency), count, axis=0)
    return scale * force, moved


def _taper(count: int, length: int) -> Floats:
    """A window (count,) that is one on the first `length` samples, with smooth slopes at both
    ends."""
    slope = max(1, round(TAPER_FRACTION * count))
    window = np.zeros(count)
    window[:length] = 1.0
    rise = np.sin(0.5 * np.pi * (np.arange(slope) + 0.5) / slope) ** 2
    window[:slope] *= rise[: len(window[:slope])]
    window[length - slope : length] *= rise[::-1]
    return window
