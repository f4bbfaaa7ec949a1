"""The kinds of light, each with its own formulas."""

from __future__ import annotations

from ..core.sensor import Sensor

#: The kinds of real light, each of which has code without branches. Values: whether the reflectance
#: depends on the angle of incidence, whether the light is polarised, and whether the beam's profile
#: is not Gaussian.
LIT = {
    f"{name}{suffix}": (coated, polarised, profiled)
    for profiled, suffix in ((False, ""), (True, "_profiled"))
    for name, coated, polarised in (
        ("light", False, False),
        ("light_coated", True, False),
        ("light_polarised", True, True),
    )
}


#: Any light of LIT: the kind of derivatives whose code is compiled once for all kinds.
ANY_LIGHT = "any_light"
#: The kinds of light that apertures cut, in the form of LIT; None for ideal light. Coatings are the
#: only effects of such light.
CUT = {"cut": None, **{f"cut_{kind}": LIT[kind] for kind in LIT if not LIT[kind][2]}}


def kind_of(sensor: Sensor) -> str:
    """The kind of a sensor's light: "plain", or one of LIT or CUT; cached per sensor."""
    kind: str | None = sensor.__dict__.get("_kind")
    if kind is None:
        kind = lit_kind(sensor) if sensor.light.on else "plain"
        if sensor.apertures.cut:
            kind = f"cut_{kind}" if sensor.light.on else "cut"
        sensor.__dict__["_kind"] = kind
    return kind


def lit_kind(sensor: Sensor) -> str:
    """The kind of LIT of a sensor's light, whether or not any effect is on."""
    light = sensor.light
    kind = "light"
    if light.index is not None:
        kind = "light_coated" if light.polarization is None else "light_polarised"
    return f"{kind}_profiled" if light.has_profile else kind


def block_kind(sensor: Sensor) -> str | None:
    """The kind of light of formulas with a sensor for each reading: "plain", or one of LIT; None
    where the light is cut."""
    return None if sensor.apertures.cut else kind_of(sensor)
