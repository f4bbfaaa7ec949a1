"""Which formulas hold for a sensor."""

from __future__ import annotations

from ..core.sensor import Sensor

#: The kinds of a bench's light, by whether the facets' coating reflects by incidence and whether
#: the light is polarised: code without branches is written for each.
LIT = {"light": (False, False), "light_coated": (True, False), "light_polarised": (True, True)}


def kind_of(sensor: Sensor) -> str:
    """Which formulas hold for a sensor; found once a sensor."""
    known: str | None = sensor.__dict__.get("_kind")
    if known is None:
        if sensor.apertures.cut:
            known = "cut_light" if sensor.light.on else "cut"
        else:
            known = lit_kind(sensor) if sensor.light.on else "plain"
        sensor.__dict__["_kind"] = known
    return known


def lit_kind(sensor: Sensor) -> str:
    """Which of LIT the light of a sensor's bench is, whether or not it is on."""
    if sensor.light.index is None:
        return "light"
    return "light_coated" if sensor.light.polarization is None else "light_polarised"


def block_kind(sensor: Sensor) -> str | None:
    """Which formulas blocks of poses take: "plain", or one of LIT; None where the light is cut."""
    return None if sensor.apertures.cut else kind_of(sensor)
