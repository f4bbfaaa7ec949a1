"""Columns and values of auxiliary channels; a wrong declaration is refused with its line."""

from __future__ import annotations

import numpy as np
import pytest

import facets
from facets.core import AuxiliaryChannel, ConfigError, column_ending


@pytest.mark.parametrize(
    ("unit", "ending"),
    [("degC", "c"), ("°C", "c"), ("mA", "ma"), ("m/s^2", "m_s2"), ("1/min", "per_min"),
     ("%", "percent"), ("µm", "um"), ("N m", "n_m"), ("1", ""), ("mm/s²", "mm_s2"),
     ("m/s2", "m_s2"), ("μm", "um"), ("m/s", "m_s"), ("°/s", "deg_s"), ("1/(m/s²)", "per_m_s2"),
     ("nV/rtHz", "nv_rthz"), ("kN", "kn")],
)  # fmt: skip
def test_a_column_ends_with_its_unit(unit, ending):
    assert column_ending(unit) == ending


@pytest.mark.parametrize("unit", ["Nm", "MW", "C", "S", "n", "l/s", "N mm", "1/m/s^2", "KHz/s"])
def test_a_column_never_ends_as_that_of_another_unit(unit):
    assert AuxiliaryChannel("load", unit).column == "load"


def test_values_are_scaled_and_unknown_ones_are_nan():
    channel = AuxiliaryChannel("force", "N", scale=0.5, offset=-1.0)
    raw = np.array([4.0, np.nan, np.inf, -2.0], np.float32)
    np.testing.assert_array_equal(channel.values(raw), [1.0, np.nan, np.nan, -2.0])
    np.testing.assert_array_equal(channel.raw(channel.values(raw))[[0, 3]], raw[[0, 3]])
    assert channel.column == "force_n"
    assert AuxiliaryChannel("ratio").column == "ratio"


def load_with(tmp_path, channels: str):
    path = tmp_path / "own.yaml"
    path.write_text(f"extends: bench\nacquire:\n  channels:\n{channels}")
    return facets.load(path)


def test_a_configuration_names_channels_in_their_order(tmp_path):
    config = load_with(tmp_path, "  - {name: force, unit: N, delay_us: 20}\n  - {name: a_force}\n")
    assert [channel.column for channel in config.acquire.channels] == ["force_n", "a_force"]
    assert config.acquire.channels[0].delay == pytest.approx(20e-6)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("{name: tx, unit: mm}", "channels[0].name: its column tx_mm has another meaning"),
        ("{name: force, scale: 0}", "channels[0].scale: must not be 0"),
        ("{name: a, unit: °C}\n  - {name: a, unit: degC}", "two channels have the column a_c"),
        ("{name: a, unit: ' '}", "must be a unit of 1 to 16 characters"),
        ("7", "must be a block of keys"),
        ("\n  - ".join(f"{{name: a{n}}}" for n in range(16)), "a list of up to 15 blocks"),
    ],
)
def test_a_wrong_declaration_is_refused_with_its_place(tmp_path, line, words):
    with pytest.raises(ConfigError) as error:
        load_with(tmp_path, f"  - {line}\n")
    assert words in str(error.value)
    assert "own.yaml:" in str(error.value)
