"""Figures of invented results, by name, and the texts in a drawn figure."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from facets import POSE, Boundary
from facets.characterization import Index
from facets.core import RANGE_COLUMNS, STATE_COLUMNS


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def segment(name: str = "steps", count: int = 600, solved: bool = True) -> Any:
    """Make a motion of all axes with noise of its stated uncertainty and some unsolved samples."""
    time = np.arange(count) / 1000
    truth = np.sin(12 * time)[:, None] * [0.1, 0, 1, 2e-3, 0, 8e-3, 0, 0]
    sigma = np.tile([2e-3, 2e-3, 1e-3, 4e-6, 4e-6, 6e-6, 1e-3, 1e-3], (count, 1))
    ok = np.full(count, solved)
    ok[300:303] = False
    sigma[~ok] = np.nan
    state = truth + sigma * rng().standard_normal(truth.shape)
    solution = SimpleNamespace(state=state, uncertainty=sigma, converged=ok)
    error = (state - truth)[:, :6]
    return SimpleNamespace(name=name, time=time, truth=truth, solution=solution, error=error)


def motion(*segments: Any) -> Any:
    from facets.pictures import motion_picture

    return motion_picture(segments or [segment(), segment("a sweep with a long name", 90)])


def ranges() -> Any:
    from facets.pictures import ranges_picture

    turn = np.linspace(0, 2 * np.pi, 49)[:-1]
    size = dict(zip(POSE, [6.0, 5.0, 12.0, 0.014, 0.012, 0.024], strict=True))
    causes = np.repeat([0, 1, 2, -1], 12)
    return ranges_picture([
        Boundary(pair, np.zeros(6), np.transpose([size[pair[0]] * np.cos(turn),
                                                  size[pair[1]] * np.sin(turn)]), causes, 0)
        for pair in combinations(POSE, 2)
    ])  # fmt: skip


def resolution() -> Any:
    from facets.pictures import budget_picture

    fine = np.array([2.4e-3, 2.4e-3, 1.5e-3, 4.2e-6, 4.2e-6, 6e-6])
    sources = ("places", "powers", "beam position")
    rows = [
        SimpleNamespace(how=SimpleNamespace(name=name), nominal=size * fine, worst=2 * size * fine,
                        shares=np.tile([1 - share, 0.0, share], (6, 1)), sources=sources,
                        object=None)
        for name, size, share in (("paper: 8 readings", 1.0, 0.0), ("beam within 5 µm", 0.8, 0.18),
                                  ("beam known", 0.03, 0.0))
    ]  # fmt: skip
    return budget_picture(rows)


def layout() -> Any:
    from facets.pictures import layout_picture

    fine = [f"u_{name.replace('_mm', '_um').replace('_mrad', '_urad')}" for name in STATE_COLUMNS]
    before = np.array([0.681, 0.66, 1.2, 3.8, 3.9, 6.1, 0.359, 0.39, 12.1, 28, 24.3, 49])
    after = np.array([0.466, 0.47, 0.9, 2.4, 2.4, 4.4, 0.355, 0.38, 11, 25, np.nan, 60])
    simulated = np.where(np.arange(12) < 6, 1.03 * after, np.nan)
    names = np.array([*fine[:6], *RANGE_COLUMNS])
    return layout_picture(
        {"quantity": names, "before": before, "after": after, "simulated": simulated}
    )


def designs() -> dict[str, Any]:
    head, fine, reach = rng().random((3, 300))
    head = 150 + 400 * head
    table = {"head_mm": head, "u_roll_urad": 4e3 / head * (1 + fine)}
    table["range_roll_mrad"] = 20 + 30 * reach - 8 * fine + 0.03 * head
    table["range_roll_mrad"][:40] = np.nan
    return table


def front() -> Any:
    from facets.design import exploration
    from facets.pictures import front_picture

    table = designs()
    names = list(table)
    indices = dict.fromkeys(names, dict.fromkeys(("radius_mm", "pitch_mrad"), Index(0.3, 0.08)))
    own = {"head_mm": 500.0, "u_roll_urad": 8.5, "range_roll_mrad": 40.0}
    return front_picture(table, exploration.front(table, names), names, indices, own)


def pareto() -> Any:
    from facets.pictures import pareto_picture

    place = np.linspace(4, 9, 9)
    price = np.array([np.nan, *np.linspace(0.02, 0.4, 7), np.nan])
    table = {"u_roll_urad": place, "range_roll_mrad": 90 - 300 / place,
             "u_roll_urad_per_range_roll_mrad": price}  # fmt: skip
    own = {"u_roll_urad": 7.0, "range_roll_mrad": 40.0}
    return pareto_picture(table, ["u_roll_urad", "range_roll_mrad"], None, own)


def calibration() -> Any:
    from facets.pictures import residual_picture

    table = {
        "unit": np.array(["um"] * 3 + ["urad"] * 3), "before": np.geomspace(90, 1200, 6),
        "after": np.array([1.1, 1.2, 1.6, 4.4, 4.3, 6.2]), "stated": np.full(6, 1.5),
    }  # fmt: skip
    before, after = rng().standard_normal((2, 400, 9))
    return residual_picture(SimpleNamespace(raw=before), SimpleNamespace(left=after), table)


def survey() -> Any:
    from facets.pictures import survey_picture

    counts = rng().poisson(3, (40, 40)).astype(float)
    edges = [np.linspace(low, high, 41) for low, high in ((0, 0.3), (-4e6, 4e6), (0, 2e-3))]
    share = np.linspace(-0.1, 1.1, 50)
    pair = SimpleNamespace(
        share=share, apart=np.abs(np.sin(np.pi * share)), determinant=1e5 * (0.5 - share)
    )
    search = SimpleNamespace(counts=counts, second=counts, edges=edges)
    return survey_picture(search, "power_c", pair)


def spots() -> Any:
    import facets
    from facets.pictures import spots_picture

    return spots_picture(
        facets.load("bench").sensor, np.array([0.08, 0.05, 0, 8e-3, 6e-3, 0, 0, 0])
    )


def plan() -> Any:
    import facets
    from facets.pictures import plan_picture

    return plan_picture(facets.load("bench").sensor, np.zeros(8))


FIGURES = (
    motion, ranges, resolution, layout, front, pareto, calibration, survey, spots, plan,
)  # fmt: skip
#: All figures by name.
ALL = {figure.__name__: figure for figure in FIGURES}


def texts_of(picture: Any) -> list[tuple[Any, Any]]:
    """Draw a figure and return each text with its bounding box in pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    from facets.pictures import lay_out

    canvas = FigureCanvasAgg(picture)
    lay_out(picture, 100)
    drawn: list[Any] = []
    with patch.object(Text, "draw", autospec=True, side_effect=Text.draw) as draw:
        canvas.draw()
        for call in draw.call_args_list:
            text, renderer = call.args[:2]
            if text.get_visible() and text.get_text().strip():
                drawn.append((text, Text.get_window_extent(text, renderer)))
    return drawn
