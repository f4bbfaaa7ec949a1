"""Does every sub-beam of a configured sensor find its detector, with the mirror at rest at zero?

If not, some key is wrong. The key blamed is the one whose return to the paper's value brings the
spot closest to the middle of its detector.
"""

from __future__ import annotations

import copy
import math
from typing import Any, NamedTuple

from ..core.names import DETECTORS
from ..core.sensor import Sensor
from ..model.arrays import geometry_of, on_detectors
from ..optics.forward import path, readings, scene
from . import build
from .problems import quoted
from .yaml_positions import Marked, Path_, dotted

ZERO = (0.0,) * 8
NOMINAL: dict[str, dict[str, Any]] = {
    "mirror": {"inclination_deg": 45.0},
    "psd": {
        "radius_mm": 250.0,
        "height_mm": 0.0,
        "roll_mrad": 0.0,
        "pitch_mrad": 0.0,
        "yaw_mrad": 0.0,
        "size_mm": [13.0, 13.0],
    },
}


class Landing(NamedTuple):
    """Where a sub-beam lands, mm, in its detector's frame; on its area or not."""

    psi: float
    zeta: float
    on: bool


def problems(keys: dict[str, Any], tree: Marked) -> list[str]:
    """A line for each key of the resolved `sensor` block that makes a sub-beam miss."""
    disorder = _disorder(keys["mirror"], tree)
    if disorder:
        return [disorder]
    sensor = build.sensor(keys)
    lost = [k for k, landing in enumerate(landings(sensor)) if not landing.on]
    culprits: dict[Path_, list[int]] = {}
    for k in lost:
        culprits.setdefault(_given(_culprit(keys, k), tree), []).append(k)
    return [_missed(keys, tree, culprit, ks) for culprit, ks in culprits.items()]


def _disorder(mirror: dict[str, Any], tree: Marked) -> str:
    """Facets that do not make a pyramid: a, b, c must go round once, counter-clockwise."""
    azimuths = [mirror[name]["azimuth_deg"] for name in DETECTORS]
    gaps = [(azimuths[(k + 1) % 3] - azimuths[k]) % 360 for k in range(3)]
    if all(0 < gap < 180 for gap in gaps):
        return ""
    moved = [k for k in range(3) if azimuths[k] % 360 != 120 * k]
    place: Path_ = ("sensor", "mirror", DETECTORS[moved[0]], "azimuth_deg")
    return (
        f"{tree.find(place)[0].place}: {dotted(place)}: facets a, b, c must follow one another "
        f"counter-clockwise seen from above, each by less than 180 deg (got {_short(azimuths)}; "
        "allowed: for instance 0, 120, 240)"
    )


def landings(sensor: Sensor) -> list[Landing]:
    """Of the three sub-beams at the nominal pose; NaN where one never meets its detector."""
    try:
        spots = readings(geometry_of(sensor), ZERO)
    except ZeroDivisionError:  # a ray exactly along a plane
        return [Landing(math.nan, math.nan, False)] * 3
    on = on_detectors(sensor, [number for spot in spots for number in spot])
    return [Landing(spots[k][0], spots[k][1], bool(on[k])) for k in range(3)]


def _culprit(keys: dict[str, Any], k: int) -> Path_:
    """The path, below `sensor`, of the key that most likely sends sub-beam k astray."""
    name = DETECTORS[k]
    suspects: list[tuple[Path_, Any]] = [(("beam", "tilt_mrad"), [0.0, 0.0])]
    for block, nominal in NOMINAL.items():
        suspects += [((block, name, key), value) for key, value in nominal.items()]
        suspects.append(((block, name, "azimuth_deg"), 120.0 * k))
    changed = [(path, value) for path, value in suspects if _at(keys, path) != value]
    if not changed:
        return ("psd", name)
    return min(changed, key=lambda suspect: _miss(_with(keys, *suspect), k))[0]


def _at(keys: Any, path: Path_) -> Any:
    for key in path:
        keys = keys[key]
    return keys


def _with(keys: dict[str, Any], path: Path_, value: Any) -> dict[str, Any]:
    keys = copy.deepcopy(keys)
    _at(keys, path[:-1])[path[-1]] = value
    return keys


def _miss(keys: dict[str, Any], k: int) -> float:
    """How far spot k lies from the middle of its detector, in half-sizes."""
    sensor = build.sensor(keys)
    spot, psd = landings(sensor)[k], sensor.psds[k]
    miss = max(abs(spot.psi) / psd.size_y, abs(spot.zeta) / psd.size_z) * 2
    return math.inf if math.isnan(miss) else miss


def _given(culprit: Path_, tree: Marked) -> Path_:
    """The key as the file has it: the detector's own, or the one common to the three."""
    block, *_, key = culprit
    for place in (("sensor", *culprit), ("sensor", block, key)):
        if tree.find(place)[1] == place:
            return place
    return ("sensor", *culprit)


def _missed(keys: dict[str, Any], tree: Marked, culprit: Path_, lost: list[int]) -> str:
    mark, _ = tree.find(culprit)
    sensor = build.sensor(keys)
    names = ", ".join(DETECTORS[k] for k in lost)
    if len(lost) == 1:
        what = f"facet {names} sends its sub-beam past PSD {names} at the nominal pose: it "
        what += _where(sensor, lost[0])
    else:
        what = f"facets {names} send their sub-beams past their PSDs at the nominal pose: "
        what += "; ".join(f"{DETECTORS[k]} {_where(sensor, k)}" for k in lost)
    got = f"got {quoted(mark.plain())}; {_remedy(keys, culprit, lost)}"
    return f"{mark.place}: {dotted(culprit)}: {what} ({got})"


def _where(sensor: Sensor, k: int) -> str:
    spot, psd = landings(sensor)[k], sensor.psds[k]
    if math.isnan(spot.psi):
        return _why_never(sensor, k)
    beyond = max(abs(spot.psi) - psd.size_y / 2, abs(spot.zeta) - psd.size_z / 2)
    psi, zeta = round(spot.psi, 1) + 0.0, round(spot.zeta, 1) + 0.0  # + 0.0: no -0.0
    return f"lands at psi {psi:g}, zeta {zeta:g} mm, {beyond:.1f} mm beyond the edge"


def _why_never(sensor: Sensor, k: int) -> str:
    geometry = geometry_of(sensor)
    try:
        ray = path(geometry, scene(geometry, ZERO), k)
    except ZeroDivisionError:
        return "grazes a plane and lands nowhere"
    if ray.incidence >= 0:
        return "is turned away from the beam"
    return "never meets the plane of its PSD, or only its back"


def _remedy(keys: dict[str, Any], culprit: Path_, lost: list[int]) -> str:
    """What would bring the spots back, as far as one change can."""
    k = lost[0]
    own = _culprit(keys, k)
    nominal = _nominal(own, k)
    cures = []
    if nominal is not None and _miss(_with(keys, own, nominal), k) <= 1:
        cures.append(f"{_short(nominal)} would bring it back")
    height: Path_ = ("psd", DETECTORS[k], "height_mm")
    zeta = landings(build.sensor(keys))[k].zeta
    if "inclination_deg" in culprit and not math.isnan(zeta):
        lifted = round(_at(keys, height) + zeta, 1)
        if _miss(_with(keys, height, lifted), k) <= 1:
            key = "psd.height_mm" if len(lost) == 3 else dotted(height)
            cures.append(f"or set sensor.{key} to {lifted:g}")
    return "; ".join(cures) or "more than one key keeps it off"


def _short(value: Any) -> str:
    """45 for 45.0, [0, 0] for [0.0, 0.0]."""
    if isinstance(value, list):
        return f"[{', '.join(_short(item) for item in value)}]"
    return f"{value:g}"


def _nominal(path: Path_, k: int) -> Any:
    if path[-1] == "tilt_mrad":
        return [0.0, 0.0]
    if path[-1] == "azimuth_deg":
        return 120.0 * k
    return NOMINAL[str(path[0])].get(str(path[-1]))
