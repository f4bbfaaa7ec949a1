"""Which formulas hold for a sensor."""

from __future__ import annotations

from ..core.sensor import Sensor


def kind_of(sensor: Sensor) -> str:
    """Which formulas hold for a sensor; found once a sensor."""
    known: str | None = sensor.__dict__.get("_kind")
    if known is None:
        bare = "cut" if sensor.apertures.cut else "plain"
        both = "cut_light" if sensor.apertures.cut else "light"
        known = both if sensor.light.on else bare
        sensor.__dict__["_kind"] = known
    return known
