"""Makes diffraction.json: readings of PSD A from a scalar field, without a line of the project.

    python tests/optics/references/make_diffraction.py            # two minutes of one core
    python tests/optics/references/make_diffraction.py --by-fft   # five more, and 4 GB

The mirror stands level and is unfolded: a facet cuts the beam at the apex's height, and the
detector's plane lies 250 mm less tx further on, square to the light. Fresnel's integral of a
Gaussian field over the wedge is closed along y (Faddeeva's function) and done by Gauss and
Legendre's rule along x; the light in a window of 13 mm by the same rule in both directions. With
half as many nodes again the places change by 1e-6 um.

`--by-fft` propagates some of the fields by their angular spectrum instead, which is not paraxial
and knows nothing of wedges, on a grid, and stores what it found beside: "by_fft".
"""

import hashlib
import itertools
import json
import sys
from pathlib import Path

import numpy as np
from scipy import fft
from scipy.special import wofz

SEED = 20240607
WAVELENGTH, DISTANCE, HALF = 632.8e-6, 250.0, 6.5
ROUND = (0.425, 0.425, 0.0)  # semi-axes to 1/e^2, mm, and how the ellipse is turned
LEVEL = (120.0, 240.0)  # azimuths of facets B and C, deg
#: How far the windows' middles lie from the spot, mm: to 1.2 mm from the window's edge.
AWAY = [(0, 0), (2, 0), (0, -3), (4, 2), (-5, 1), (1, 5.3), (-5.3, -5.3), (3, -4.5), (-2.5, 4)]
#: Where the light that an edge spreads leaves through the window's corner.
CORNERS = [(5.3, 4.8), (-5.3, 4.8), (-5.3, -4.3), (4.8, -5.3)]
#: Poses tx, ty, tz (mm) of which all three detectors are read, with their windows' middles at rest.
POSES = [(0.08, -0.05, 4.0), (-0.06, 0.03, -4.5), (0.11, 0.09, 4.9), (-0.1, -0.12, -4.9)]


def at(tx: float, ty: float, radius: float | None, axes=ROUND, azimuths=LEVEL) -> dict:
    """A case: the apex (mm), the wavefront's radius at the beam's place (mm; None for plane), the
    beam's semi-axes (1/e^2, mm) and how they are turned (rad), and the other facets' azimuths."""
    return {
        "apex": [tx, ty], "wavefront_radius": radius, "axes": list(axes), "azimuths": list(azimuths)
    }  # fmt: skip


def cases() -> list[tuple[dict, list]]:
    """Cases, and how far the middles of their windows lie from the spot."""
    fixed = [
        (at(0.0, 0.0, None), AWAY),
        (at(0.1, 0.05, None), AWAY),
        (at(-0.1, 0.08, None), AWAY),
        (at(0.06, -0.1, 3000.0), AWAY),
        (at(-0.05, -0.02, 3000.0), AWAY),
        (at(0.119, -0.062, 2100.0), CORNERS),
        (at(-0.1, 0.1, -2000.0), CORNERS),
        (at(0.05, -0.04, 2500.0, (0.4, 0.45, 0.6)), [*CORNERS, *AWAY[:6]]),
        (at(0.03, 0.06, None, (0.45, 0.39, -0.4), (112.0, 231.0)), [*CORNERS, *AWAY[:6]]),
    ]
    rng = np.random.default_rng(SEED)
    for _ in range(8):
        tx, ty = rng.uniform(-0.12, 0.12, 2).round(3)
        radius = [None, 3000.0, -2000.0][rng.integers(3)]
        ring = rng.uniform(-5.3, 5.3, (3, 2)).round(2)
        ring[np.arange(3), rng.integers(2, size=3)] = rng.choice([-5.3, 5.3], 3)
        fixed.append((at(float(tx), float(ty), radius), ring.tolist()))
    return fixed


def panels(low: float, high: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss and Legendre's nodes and weights in `count` panels of 20."""
    x, w = np.polynomial.legendre.leggauss(20)
    ends = np.linspace(low, high, count + 1)
    half, middle = np.diff(ends) / 2, (ends[1:] + ends[:-1]) / 2
    return (middle[:, None] + half[:, None] * x).ravel(), (half[:, None] * w).ravel()


def between(a: complex, b: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The integral of exp(-a y^2 + b y) from low to high."""
    root = np.sqrt(a)

    def tail(end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z = root * end - b / (2 * root)
        behind = z.real < 0  # then from minus infinity up to the end
        part = np.exp(-a * end**2 + b * end) * wofz(1j * np.where(behind, -z, z))
        return np.where(behind, -1, 1) * part * np.sqrt(np.pi) / (2 * root), behind

    (first, from_below), (last, to_below) = tail(low), tail(high)
    crossed = from_below.astype(int) - to_below.astype(int)
    return first - last + crossed * np.sqrt(np.pi / a) * np.exp(b * b / (4 * a))


def edges(azimuths: list) -> list[float]:
    """The slopes y / x of facet A's edges, with facets inclined by 45 degrees."""
    a, b, c = (np.array([np.cos(z), np.sin(z), 1.0]) for z in np.radians([0.0, *azimuths]))
    along = np.cross(c, a), np.cross(a, b)
    return [float(v[1] / v[0]) for v in along]


def beam(case: dict) -> tuple[np.ndarray, float]:
    """The inverse (2, 2) of the irradiance's covariance, and the amplitude at its middle, 1/mm."""
    x, y, turn = case["axes"]
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    inverse = turned @ np.diag([4 / x**2, 4 / y**2]) @ turned.T
    return inverse, float(np.sqrt(2 / (np.pi * x * y)))


def field(case: dict, x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
    """The field at the places x (n,) by y (m,) of the detector's plane, mm from below the apex."""
    (tx, ty), radius = case["apex"], case["wavefront_radius"]
    distance, wave = DISTANCE - tx, np.pi / WAVELENGTH
    bend = 0.0 if radius is None else 1 / radius
    inverse, amplitude = beam(case)
    (xx, xy), (_, yy) = inverse / 4
    low, high = edges(case["azimuths"])
    s, weights = panels(0, 2.2, count)
    s, weights = s[:, None], weights[:, None]
    a = yy - 1j * wave * (bend + 1 / distance)
    b = -2 * (yy * ty + xy * (s + tx)) + 2j * wave * (bend * ty - y / distance)
    rows = between(a, b, low * s, high * s)
    own = -xx * (s + tx) ** 2 - 2 * xy * (s + tx) * ty - yy * ty**2
    own = own + 1j * wave * (bend * ((s + tx) ** 2 + ty**2) + s**2 / distance)
    turns = np.exp(-2j * wave / distance * np.outer(x, s))
    return turns @ (weights * np.exp(own) * rows) * amplitude / (WAVELENGTH * distance)


def read(case: dict, window: list, nodes: tuple[int, int] = (48, 48)) -> list:
    """Place (mm, from the window's middle) and share of the light in a window."""
    psi, on_psi = panels(window[0] - HALF, window[0] + HALF, nodes[0])
    zeta, on_zeta = panels(window[1] - HALF, window[1] + HALF, nodes[0])
    light = np.abs(field(case, -zeta, psi - case["apex"][1], nodes[1])) ** 2
    power = on_zeta @ light @ on_psi
    y = on_zeta @ light @ (on_psi * psi) / power - window[0]
    z = (on_zeta * zeta) @ light @ on_psi / power - window[1]
    return [float(y), float(z), float(power)]


def spot(case: dict) -> np.ndarray:
    """The middle of the light in a window that is drawn to it, mm."""
    place = np.zeros(2)
    for _ in range(3):
        place = place + read(case, place.tolist())[:2]
    return place


def detector_a(case: dict, away: list) -> list:
    """Readings of detector A, its window in turn at each of `away` from the spot."""
    middles = np.round(spot(case) - np.array(away), 6).tolist()
    return [{**case, "window": middle, "reading": read(case, middle)} for middle in middles]


def pose(tx: float, ty: float, tz: float) -> dict:
    """Readings of all three detectors: those of A with the apex turned back by 120 and 240 deg."""
    reading: list = []
    for turn in -2 * np.pi / 3 * np.arange(3):
        x = tx * np.cos(turn) - ty * np.sin(turn)
        y = tx * np.sin(turn) + ty * np.cos(turn)
        reading += read(at(x, y, None), [0.0, -tz])
    return {"pose": [tx, ty, tz], "reading": reading}


def covered(case: dict, x: np.ndarray, y: np.ndarray, step: float, parts: int = 12) -> np.ndarray:
    """What share of each cell the facet covers."""
    low, high = edges(case["azimuths"])

    def within(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return (y > low * x) & (y < high * x) & (x > 0)

    share = within(x, y).astype(np.float32)
    near = np.minimum(np.abs(y - low * x), np.abs(y - high * x)) < 4 * step
    inner = ((np.arange(parts) + 0.5) / parts - 0.5) * step
    fine = within(x[near][:, None, None] + inner[:, None], y[near][:, None, None] + inner)
    share[near] = fine.mean(axis=(1, 2))
    return share


def by_fft(case: dict, windows: list, count: int, step: float) -> list:
    """Readings in windows from the angular spectrum on `count`^2 cells of `step` mm."""
    (tx, ty), radius = case["apex"], case["wavefront_radius"]
    distance, number = DISTANCE - tx, 2 * np.pi / WAVELENGTH
    places = (np.arange(count) - count // 2) * step
    x, y = np.meshgrid(places, places, indexing="ij")
    inverse, amplitude = beam(case)
    (xx, xy), (_, yy) = inverse / 4
    square = xx * (x + tx) ** 2 + 2 * xy * (x + tx) * (y + ty) + yy * (y + ty) ** 2
    u = (covered(case, x, y, step) * np.exp(-square) * amplitude * step).astype(np.complex64)
    if radius is not None:
        curve = np.pi / (WAVELENGTH * radius) * ((x + tx) ** 2 + (y + ty) ** 2)
        u *= np.exp(1j * curve).astype(np.complex64)
    del x, y, square
    u = fft.fft2(u, workers=2, overwrite_x=True)
    wave = 2 * np.pi * fft.fftfreq(count, step)
    cell = 1 / np.sinc(wave * step / (2 * np.pi))  # what a cell's mean takes off, given back
    lands = np.abs(wave) * distance / number < count * step / 2  # else it would come in again
    for row, across in enumerate(wave):
        across2 = across**2 + wave**2
        phase = -distance * across2 / (number + np.sqrt(number**2 - across2))
        u[row] *= np.exp(1j * phase) * (cell * lands) * (cell[row] * lands[row])
    u = fft.ifft2(u, workers=2, overwrite_x=True)
    light = u.real.astype(np.float64) ** 2 + u.imag.astype(np.float64) ** 2
    return [in_window(light, places + ty, -places, window, step) for window in windows]


def in_window(
    light: np.ndarray, psi: np.ndarray, zeta: np.ndarray, window: list, step: float
) -> list:
    on_y = np.clip((HALF - np.abs(psi - window[0])) / step + 0.5, 0, 1)
    on_z = np.clip((HALF - np.abs(zeta - window[1])) / step + 0.5, 0, 1)
    by_y, by_z = on_z @ light, light @ on_y
    power = by_y @ on_y
    y = by_y @ (on_y * psi) / power - window[0]
    z = by_z @ (on_z * zeta) / power - window[1]
    return [float(y), float(z), float(power)]


#: The cases that are propagated by FFT too, and the grids: cells along a side, and their size, mm.
BY_FFT, GRIDS = (3, 5, 8), ((5120, 0.005), (8192, 0.004))


def main() -> None:
    path = Path(__file__).with_name("diffraction.json")
    made = [detector_a(*each) for each in cases()]
    content = {
        "made_by": {
            "script_sha256": hashlib.sha256(Path(__file__).read_bytes()).hexdigest(),
            "seed": SEED,
            "numpy": np.__version__,
        },
        "wavelength": WAVELENGTH,
        "cases": list(itertools.chain(*made)),
        "poses": [pose(*each) for each in POSES],
    }
    if "--by-fft" in sys.argv:
        content["by_fft"] = [
            {"case": each["window"], "reading": each["reading"], "cells": count, "found": found}
            for number, (count, step) in itertools.product(BY_FFT, GRIDS)
            for each, found in zip(
                made[number],
                by_fft(cases()[number][0], [e["window"] for e in made[number]], count, step),
                strict=True,
            )
        ]
    elif path.exists():
        content["by_fft"] = json.loads(path.read_text()).get("by_fft", [])
    path.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
