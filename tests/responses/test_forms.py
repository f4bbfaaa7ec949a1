"""The forms of a response, beside the closed forms of a mass on a spring and a damper."""

import numpy as np
import pytest

from facets.responses import (
    FORMS,
    OutputChannel,
    estimate_response,
    find_stretches,
    response_table,
)

#: kg, N s/m, N/m
MASS, DAMPER, SPRING = 2.0, 30.0, 4e5
FREQUENCY = np.array([1.0, 30.0, 71.2, 400.0])
TURN = 2j * np.pi * FREQUENCY
#: N/m, with which the closed forms are written
STIFFNESS = SPRING + DAMPER * TURN + MASS * TURN**2


@pytest.mark.parametrize(
    ("name", "true", "unit"),
    [  # in the units of the columns
        ("receptance", 1e6 / STIFFNESS, "um"),
        ("mobility", 1e3 / (MASS * TURN + DAMPER + SPRING / TURN), "mm_s"),
        ("accelerance", 1 / (MASS + DAMPER / TURN + SPRING / TURN**2), "m_s2"),
        ("dynamic-stiffness", 1e-6 * STIFFNESS, "per_um"),
        ("mechanical-impedance", 1e-3 * (MASS * TURN + DAMPER + SPRING / TURN), "per_mm_s"),
        ("apparent-mass", MASS + DAMPER / TURN + SPRING / TURN**2, "per_m_s2"),
    ],
)
def test_a_mass_on_a_spring_and_a_damper(name, true, unit):
    form, receptance = FORMS[name], 1e3 / STIFFNESS[:, None]  # mm/N
    assert form.unit_of("tz") == unit
    assert form.factor("tz") * form.convert(FREQUENCY, receptance)[:, 0] == pytest.approx(true)


def test_angles_have_their_own_units():
    assert [form.unit_of("yaw") for form in FORMS.values()] == [
        "urad", "mrad_s", "rad_s2", "per_urad", "per_mrad_s", "per_rad_s2",
    ]  # fmt: skip
    assert [form.factor("yaw") for form in FORMS.values()] == pytest.approx(
        [1e6, 1e3, 1, 1e-6, 1e-3, 1]
    )
    assert FORMS["mobility"].unit_text("yaw", "N") == "mrad/s per N"
    assert FORMS["apparent-mass"].unit_text("tz", "N") == "N per m/s²"


def test_errors_and_noise_go_with_the_form():
    force, *noise = np.random.default_rng(2).standard_normal((7, 20_000))
    moved = np.transpose(1e-3 * force + 1e-4 * np.array(noise))
    stretches = find_stretches(np.arange(20_000) / 1000, np.ones(20_000, bool), "it")
    found = estimate_response(force, moved, stretches, 4, OutputChannel(np.full(6, 1e-4)))
    assert response_table(found)["u_h1_yaw_urad"] == pytest.approx(1e6 * found.uncertainty[:, 5])
    turn = 2 * np.pi * found.frequency
    receptance, mobility, stiffness = (
        response_table(found.convert(FORMS[name]))
        for name in ("receptance", "mobility", "dynamic-stiffness")
    )
    for ending in ("u_h1_tz", "noise_tz"):
        ratio = mobility[f"{ending}_mm_s"] / receptance[f"{ending}_um"]
        assert ratio == pytest.approx(1e-3 * turn)
    relative = found.random_error[:, 2]
    size = np.hypot(stiffness["h1_tz_real_per_um"], stiffness["h1_tz_imag_per_um"])
    assert stiffness["u_h1_tz_per_um"] == pytest.approx(size * relative)
    assert stiffness["noise_tz_per_um"] * receptance["noise_tz_um"] == pytest.approx(1)
