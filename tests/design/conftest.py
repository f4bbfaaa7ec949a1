"""A configuration that the tests of tolerances and of reports share."""

from __future__ import annotations

#: Heads of which about half meet the requirements as the layout is, and an aim of one search.
LOOSE = """
extends: layout
calibrate:
  before: {psd_place_mm: 0.05, psd_turn_mrad: 2, facet_mrad: 0.5, beam_tilt_mrad: 0.5,
           beam_diameter_percent: 2, power_percent: 2, scale_percent: 0.5}
optimize:
  starts: 1
  limit: {tz_um: 2.4, roll_urad: 8, pitch_urad: 8, yaw_urad: 10}
"""
