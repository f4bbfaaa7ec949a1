"""Convert counts of a detector board to readings, and back for a virtual board.

A count is one step of the converter behind an electrode's transimpedance amplifier. Some boards
combine the electrodes themselves and send X, Y and SUM: X / SUM is the position in half sizes, SUM
the photocurrent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..core.sensor import Electronics, Sensor
from ..core.units import Floats
from ..model.arrays import half_sizes, mask_missed_spots
from . import electrodes
from .noise import add_current_noise, electrode_currents, has_two_layers

#: Flags of a faulty sample: a converter is at the end of its range; or the sums along y and z of a
#: duo-lateral PSD, which measure the same light, differ by more than MISMATCH.
SATURATED, UNEQUAL = 1, 2
#: Largest allowed difference of the two sums, as a fraction of the photocurrent.
MISMATCH = 0.02


def counts_per_ampere(electronics: Electronics) -> float:
    """Counts per ampere of an electrode."""
    return electronics.transimpedance * 2.0**electronics.adc_bits / electronics.adc_range


def readings_to_counts(
    sensor: Sensor, electronics: Electronics, exact: Floats, rng: np.random.Generator | None = None
) -> NDArray[np.int32]:
    """Convert readings without noise (n, 9) to the converters' counts (n, 12).

    A detector without a finite reading, or whose spot is past its edge, has no current.  rng: adds
    the electronics' noise, if given.
    """
    light = mask_missed_spots(sensor, exact, exact).reshape(-1, 3, 3)
    currents = np.nan_to_num(electrode_currents(electronics, half_sizes(sensor), light))
    if rng is not None:
        currents = add_current_noise(electronics, currents, rng)
    counts = np.round(currents.reshape(-1, 12) * counts_per_ampere(electronics))
    top = 2**electronics.adc_bits - 1
    return np.clip(counts, -top, top).astype(np.int32)


def counts_to_xy_sum(electronics: Electronics, counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Convert electrode counts (n, 12) to X, Y, SUM and a spare 0 of each detector (n, 12).

    X and Y are scaled so that X / SUM is the position in half sizes.
    """
    out = np.zeros_like(counts)
    for k in range(3):
        currents = counts[:, 4 * k : 4 * k + 4].astype(float)
        total = electrodes.total(electronics.kind, currents)
        with np.errstate(divide="ignore", invalid="ignore"):
            place = np.nan_to_num(electrodes.ratios(electronics.kind, currents))
        out[:, 4 * k : 4 * k + 2] = np.round(place * total[:, None])
        out[:, 4 * k + 2] = np.round(total)
    return out


def counts_to_readings(
    sensor: Sensor,
    electronics: Electronics,
    counts: NDArray[np.int32],
    xy_sum: bool,
    dark_counts: Floats,
) -> tuple[Floats, NDArray[np.uint8]]:
    """Convert counts (n, 12) to readings (n, 9) in mm and mW, with their flags (n,).

    xy_sum: whether the counts are X, Y, SUM and a spare number of each detector.  dark_counts:
    (12,) counts without light. A detector with a converter at the end of its range reads NaN.
    """
    half, kind = half_sizes(sensor), electronics.kind
    top = 2**electronics.adc_bits - 1
    per_milliwatt = 1e-3 * electronics.responsivity * counts_per_ampere(electronics)
    raw = counts.reshape(-1, 3, 4)
    lit = raw - dark_counts.reshape(3, 4)
    out, flags = np.empty((len(counts), 3, 3)), np.zeros(len(counts), np.uint8)
    with np.errstate(divide="ignore", invalid="ignore"):
        if xy_sum:
            total = lit[..., 2]
            ratios = lit[..., :2] / total[..., None]
        else:
            total = electrodes.total(kind, lit)
            ratios = electrodes.ratios(kind, lit)
        out[..., :2] = half * places_of_quotients(kind, ratios, half)
    out[..., 2] = total / per_milliwatt
    if raw.max(initial=0) >= top or raw.min(initial=0) <= -top:
        full = (np.abs(raw) >= top).any(axis=-1)
        out[full] = np.nan
        flags[full.any(axis=-1)] |= SATURATED
    if has_two_layers(electronics) and not xy_sum:
        difference = np.abs(lit[..., 0] + lit[..., 1] - lit[..., 2] - lit[..., 3])
        unequal = difference > MISMATCH * np.maximum(total, top / 100)
        flags[unequal.any(axis=-1)] |= UNEQUAL
    return out.reshape(-1, 9), flags


def places_of_quotients(kind: str, ratios: Floats, half: Floats) -> Floats:
    """Positions (n, 3, 2), in half sizes `half` (3, 2), from the quotients (n, 3, 2) of a kind of
    detector; NaN where no position fits."""
    if kind != "tetra-lateral":
        return ratios
    places = [
        electrodes.tetra_lateral_places(ratios[:, k], tall)
        for k, tall in enumerate(half[:, 1] / half[:, 0])
    ]
    return np.stack(places, axis=1)
