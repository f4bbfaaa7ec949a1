"""The kinds of light, each with its own formulas."""

from __future__ import annotations

from ..core.sensor import Sensor

#: The kinds of real light, by whether the coating reflects by incidence, whether the light is
#: polarised and whether the beam's profile is not Gaussian: each has code without branches.
LIT = {
    f"{name}{suffix}": (coated, polarised, profiled)
    for profiled, suffix in ((False, ""), (True, "_profiled"))
    for name, coated, polarised in (
        ("light", False, False),
        ("light_coated", True, False),
        ("light_polarised", True, True),
    )
}


#: Light that is any of LIT: one code for derivatives that are compiled for few calls.
ANY_LIGHT = "any_light"
#: The kinds of light that apertures cut, as in LIT: coatings are its only effects; None for ideal
#: light.
CUT = {"cut": None, **{f"cut_{kind}": LIT[kind] for kind in LIT if not LIT[kind][2]}}


def kind_of(sensor: Sensor) -> str:
    """The kind of a sensor's light: "plain", or one of LIT or CUT; cached per sensor."""
    known: str | None = sensor.__dict__.get("_kind")
    if known is None:
        known = lit_kind(sensor) if sensor.light.on else "plain"
        if sensor.apertures.cut:
            known = f"cut_{known}" if sensor.light.on else "cut"
        sensor.__dict__["_kind"] = known
    return known


def lit_kind(sensor: Sensor) -> str:
    """Which of LIT a sensor's light is, whether or not any effect is on."""
    light = sensor.light
    kind = "light"
    if light.index is not None:
        kind = "light_coated" if light.polarization is None else "light_polarised"
    return f"{kind}_profiled" if light.has_profile else kind


def block_kind(sensor: Sensor) -> str | None:
    """The kind of light of formulas with a sensor for each reading: "plain", or one of LIT; None
    where the light is cut."""
    return None if sensor.apertures.cut else kind_of(sensor)
