"""Check that every sub-beam of a configured sensor hits its detector with the mirror at rest.

If one does not, some key is wrong. The key that is blamed is the one of the user's own file without
which the spot comes closest to the middle of its detector.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..core.names import DETECTORS
from ..core.sensor import Apertures, BenchLight, Sensor
from ..model.arrays import geometry_of, is_on_detector
from ..model.arrays import readings as model_readings
from ..optics.forward import mirror_facets, path, readings, scene
from . import build
from .blame import culprits, message, remove_keys
from .problems import is_number, quote_value
from .yaml_positions import Marked, Path_, dotted_path

ZERO = (0.0,) * 8
Resolve = Callable[[Marked], dict[str, Any]]


class Landing(NamedTuple):
    """The place where a sub-beam lands in its detector's frame, mm, and whether it is on the
    sensitive area."""

    psi: float
    zeta: float
    on: bool


def problems(keys: dict[str, Any], tree: Marked, resolve: Resolve) -> list[str]:
    """Return a line for each key of the resolved `sensor` block that makes a sub-beam miss its
    detector or leaves it dark.

    resolve: resolves the block of another tree.
    """
    sensor = build.sensor(keys)
    lost = [k for k, landing in enumerate(landings(sensor)) if not landing.on]
    if not lost:
        return _dark_detectors(keys, sensor, tree, resolve)
    by_keys: dict[tuple[Path_, ...], list[int]] = {}
    for k in lost:
        paths = culprits(tree, ("sensor",), partial(_miss_of, resolve, k))
        by_keys.setdefault(tuple(paths), []).append(k)
    return [_miss_message(keys, tree, paths, ks, resolve) for paths, ks in by_keys.items()]


def _miss_of(resolve: Resolve, k: int, tree: Marked) -> float:
    return _miss(resolve(tree), k)


def _dark_detectors(
    keys: dict[str, Any], sensor: Sensor, tree: Marked, resolve: Resolve
) -> list[str]:
    """Return a line for each aperture that leaves a detector without light."""
    dark = [k for k, power in enumerate(_powers(sensor)) if not power > 0]
    if not dark:
        return []
    paths = culprits(tree, ("sensor",), lambda other: _darkness(resolve(other)))
    names = ", ".join(DETECTORS[k] for k in dark)
    got = f"got {quote_value(tree.find(paths[0])[0].plain())}"
    got += _advise_default(tree, paths, resolve, dark[0])
    return [message(tree, paths, f"leaves no light on PSD {names} at the nominal pose ({got})")]


def _powers(sensor: Sensor) -> list[float]:
    """The powers of the three sub-beams at the nominal pose, mW; positive where nothing cuts the
    light."""
    if sensor.apertures == Apertures() and sensor.light == BenchLight():
        return [sensor.beam.power] * 3
    powers: list[float] = model_readings(sensor, np.zeros(8))[2::3].tolist()
    return powers


def _darkness(keys: dict[str, Any]) -> float:
    """Return 0 if all detectors have light at the nominal pose."""
    sensor = build.sensor(keys)
    on = all(landing.on for landing in landings(sensor))
    return 0.0 if on and all(power > 0 for power in _powers(sensor)) else math.inf


def disorder(mirror: dict[str, Any], tree: Marked) -> list[str]:
    """Check that the facets form a pyramid: a, b, c go round once, counter-clockwise."""
    azimuths = [mirror[name]["azimuth_deg"] for name in DETECTORS]
    gaps = [(azimuths[(k + 1) % 3] - azimuths[k]) % 360 for k in range(3)]
    if all(0 < gap < 180 for gap in gaps):
        return []
    moved = [k for k in range(3) if azimuths[k] % 360 != 120 * k]
    paths = [("sensor", "mirror", DETECTORS[k], "azimuth_deg") for k in moved]
    reason = (
        "facets a, b, c must follow one another counter-clockwise seen from above, each by less "
        f"than 180 deg (got {_format_value(azimuths)}; allowed: for instance 0, 120, 240)"
    )
    return [message(tree, paths, reason)]


def landings(sensor: Sensor) -> list[Landing]:
    """The landings of the three sub-beams at the nominal pose; NaN where one misses its plane."""
    try:
        spots = readings(geometry_of(sensor), ZERO)
    except ZeroDivisionError:  # A ray may run exactly along a plane.
        return [Landing(math.nan, math.nan, False)] * 3
    on = is_on_detector(sensor, [number for spot in spots for number in spot])
    return [Landing(spots[k][0], spots[k][1], bool(on[k])) for k in range(3)]


def _value_at(keys: Any, path: Path_) -> Any:
    for key in path:
        keys = keys[key]
    return keys


def _replace_value(keys: dict[str, Any], path: Path_, value: Any) -> dict[str, Any]:
    keys = copy.deepcopy(keys)
    _value_at(keys, path[:-1])[path[-1]] = value
    return keys


def _miss(keys: dict[str, Any], k: int) -> float:
    """Distance of spot k from the middle of its detector, in half-sizes."""
    sensor = build.sensor(keys)
    spot, psd = landings(sensor)[k], sensor.psds[k]
    miss = max(abs(spot.psi) / psd.size_y, abs(spot.zeta) / psd.size_z) * 2
    return math.inf if math.isnan(miss) else miss


def _miss_message(
    keys: dict[str, Any],
    tree: Marked,
    paths: tuple[Path_, ...],
    lost: list[int],
    resolve: Resolve,
) -> str:
    sensor = build.sensor(keys)
    names = ", ".join(DETECTORS[k] for k in lost)
    if len(lost) == 1:
        what = f"facet {names} sends its sub-beam past PSD {names} at the nominal pose: it "
        what += _place_in_words(sensor, lost[0])
    else:
        what = f"facets {names} send their sub-beams past their PSDs at the nominal pose: "
        what += "; ".join(f"{DETECTORS[k]} {_place_in_words(sensor, k)}" for k in lost)
    got = f"got {quote_value(tree.find(paths[0])[0].plain())}"
    got += _advise_default(tree, paths, resolve, lost[0]) + _advise_height(keys, paths[0], lost)
    return message(tree, paths, f"{what} ({got})")


def _advise_default(tree: Marked, paths: Sequence[Path_], resolve: Resolve, k: int) -> str:
    """Advise the default value of a key, if that would bring the spot back."""
    if len(paths) > 1:
        return "; more than one key causes this"
    (_, *path) = paths[0]
    value: Any = resolve(remove_keys(tree, paths))
    if path and path[0] in ("mirror", "psd") and path[1] not in DETECTORS:
        path.insert(1, DETECTORS[k])
    for key in path:
        value = value[key]
    return f"; {_format_value(value)} would correct it"


def _place_in_words(sensor: Sensor, k: int) -> str:
    spot, psd = landings(sensor)[k], sensor.psds[k]
    if math.isnan(spot.psi):
        return _reason_of_no_landing(sensor, k)
    beyond = max(abs(spot.psi) - psd.size_y / 2, abs(spot.zeta) - psd.size_z / 2)
    psi, zeta = round(spot.psi, 1) + 0.0, round(spot.zeta, 1) + 0.0  # Adding 0.0 avoids -0.0.
    return f"lands at psi {psi:g}, zeta {zeta:g} mm, {beyond:.1f} mm beyond the edge"


def _reason_of_no_landing(sensor: Sensor, k: int) -> str:
    geometry = geometry_of(sensor)
    try:
        ray = path(mirror_facets(geometry, scene(geometry, ZERO))[k])
    except ZeroDivisionError:
        return "grazes a plane and does not land"
    if ray.incidence >= 0:
        return "is turned away from the beam"
    return "never meets the plane of its PSD, or only its back"


def _advise_height(keys: dict[str, Any], culprit: Path_, lost: list[int]) -> str:
    """Advise the height of detectors that miss the spots because of a facet's inclination."""
    k = lost[0]
    height: Path_ = ("psd", DETECTORS[k], "height_mm")
    zeta = landings(build.sensor(keys))[k].zeta
    if "inclination_deg" not in culprit or math.isnan(zeta):
        return ""
    lifted = round(_value_at(keys, height) + zeta, 1)
    if _miss(_replace_value(keys, height, lifted), k) > 1:
        return ""
    key = "psd.height_mm" if len(lost) == 3 else dotted_path(height)
    return f"; or set sensor.{key} to {lifted:g}"


def _format_value(value: Any) -> str:
    """Format a value: 45 for 45.0, [0, 0] for [0.0, 0.0]."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(_format_value(item) for item in value)}]"
    return f"{value:g}" if is_number(value) else quote_value(value)
