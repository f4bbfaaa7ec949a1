"""The functions for readings and exact derivatives under each kind of light."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from . import bench_gradient, bench_light, cut, forward


class ExactText(NamedTuple):
    """The functions that compute readings and exact derivatives under one kind of light.

    scene: the scene, from vectors and a state.  readings: from vectors and that scene.  slopes: the
    readings' derivatives, from vectors and a state that carry derivatives, and the scene without
    derivatives.
    """

    scene: Callable[..., Any]
    readings: Callable[..., Any]
    slopes: Callable[..., Any]


IDEAL = ExactText(forward.scene, forward.scene_readings, bench_gradient.ideal_slopes)
BENCH = ExactText(bench_light.scene, bench_light.scene_readings, bench_gradient.reading_slopes)
CUT = ExactText(cut.cut_scene, cut.scene_readings, cut.reading_slopes)
