"""Makes diffraction.json: readings of PSD A from a scalar field, propagated by FFT (Fresnel).

    python tests/optics/references/make_diffraction.py

The paper's sensor with its mirror level, unfolded: a facet of 120 degrees cuts the beam at the
apex's height, and the detector's plane lies 250 mm less tx further on, square to the light. The
field's grid of 5120 x 5120 cells of 5 um holds the light out to 12.8 mm; what spreads farther than
that falls beyond the detector anyway. Each reading is the light inside a window of 13 mm whose
middle lies at `window` (y, z; mm). Six minutes and 2 GB; shares no code with the project.
"""

import json
from pathlib import Path

import numpy as np
from scipy import fft

COUNT, STEP = 5120, 0.005
WAVELENGTH, DISTANCE, RADIUS, HALF = 632.8e-6, 250.0, 0.425, 6.5
#: tx, ty of the apex (mm), and the wavefront's radius at the beam's place (mm), None for plane.
CASES = [
    (0.0, 0.0, None),
    (0.1, 0.05, None),
    (-0.1, 0.08, None),
    (0.06, -0.1, 3000.0),
    (-0.05, -0.02, 3000.0),
]
#: How far the windows' middles lie from the spot, mm: to 1.2 mm from the window's edge.
AWAY = [(0, 0), (2, 0), (0, -3), (4, 2), (-5, 1), (1, 5.3), (-5.3, -5.3), (3, -4.5), (-2.5, 4)]

#: Poses tx, ty, tz (mm) of which all three detectors are read, with their windows' middles at rest.
POSES = [(0.08, -0.05, 4.0), (-0.06, 0.03, -4.5)]


def covered(x: np.ndarray, y: np.ndarray, parts: int = 12) -> np.ndarray:
    """What share of each cell the facet covers; its point is at 0, its middle along x."""
    share = (np.abs(np.arctan2(y, x)) < np.pi / 3).astype(np.float32)
    slope = np.tan(np.pi / 3)
    near = np.abs(np.abs(y) - slope * x) < 3 * STEP
    inner = ((np.arange(parts) + 0.5) / parts - 0.5) * STEP
    fine_x = x[near][:, None, None] + inner[:, None]
    fine_y = y[near][:, None, None] + inner
    share[near] = (np.abs(np.arctan2(fine_y, fine_x)) < np.pi / 3).mean(axis=(1, 2))
    return share


def light(tx: float, ty: float, radius: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance on the detector's plane, as shares of the beam a cell, and the cells' places."""
    places = (np.arange(COUNT) - COUNT // 2) * STEP
    x, y = np.meshgrid(places, places, indexing="ij")  # from the apex
    square = (x + tx) ** 2 + (y + ty) ** 2
    field = covered(x, y) * np.exp(-square / RADIUS**2)
    field = (field * np.sqrt(2 / np.pi) / RADIUS * STEP).astype(np.complex64)
    if radius is not None:
        field *= np.exp(1j * np.pi * square / (WAVELENGTH * radius)).astype(np.complex64)
    del x, y, square
    distance = DISTANCE - tx
    wave = fft.fftfreq(COUNT, STEP)
    cell = 1 / np.sinc(wave * STEP)  # what a cell's mean takes off a wave, given back
    lands = np.abs(WAVELENGTH * distance * wave) < COUNT * STEP / 2  # else it would come in again
    turn = (np.exp(-1j * np.pi * WAVELENGTH * distance * wave**2) * cell * lands).astype(
        np.complex64
    )
    spectrum = fft.fft2(field, workers=2, overwrite_x=True)
    spectrum *= turn[:, None]
    spectrum *= turn
    field = fft.ifft2(spectrum, workers=2, overwrite_x=True)
    return (field.real.astype(np.float64) ** 2 + field.imag.astype(np.float64) ** 2), places


def read(shares: np.ndarray, psi: np.ndarray, zeta: np.ndarray, middle: np.ndarray) -> list:
    """Centroid and share of the light in a window."""
    on_y = np.clip((HALF - np.abs(psi - middle[0])) / STEP + 0.5, 0, 1)
    on_z = np.clip((HALF - np.abs(zeta - middle[1])) / STEP + 0.5, 0, 1)
    by_y, by_z = on_z @ shares, shares @ on_y
    power = by_y @ on_y
    y = by_y @ (on_y * psi) / power - middle[0]
    z = by_z @ (on_z * zeta) / power - middle[1]
    return [float(y), float(z), float(power)]


def detector_a(tx: float, ty: float, radius: float | None) -> list:
    """Readings of detector A, its window in turn at each of AWAY."""
    shares, places = light(tx, ty, radius)
    psi, zeta = places + ty, -places  # the field's y and x, as the detector sees them
    spot = np.array([shares.sum(axis=0) @ psi, shares.sum(axis=1) @ zeta]) / shares.sum()
    cases = []
    for away in AWAY:
        middle = np.round(spot - away, 6)
        case = {"apex": [tx, ty], "wavefront_radius": radius, "window": middle.tolist()}
        cases.append(case | {"reading": read(shares, psi, zeta, middle)})
    return cases


def pose(tx: float, ty: float, tz: float) -> dict:
    """Readings of all three detectors: those of A with the apex turned back by 120 and 240 deg."""
    reading: list = []
    for turn in -2 * np.pi / 3 * np.arange(3):
        x = tx * np.cos(turn) - ty * np.sin(turn)
        y = tx * np.sin(turn) + ty * np.cos(turn)
        shares, places = light(x, y, None)
        reading += read(shares, places + y, -places, np.array([0, -tz]))
    return {"pose": [tx, ty, tz], "reading": reading}


def main() -> None:
    content = {
        "wavelength": WAVELENGTH,
        "cases": [case for each in CASES for case in detector_a(*each)],
        "poses": [pose(*each) for each in POSES],
    }
    path = Path(__file__).with_name("diffraction.json")
    path.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
