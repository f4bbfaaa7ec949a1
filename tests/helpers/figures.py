"""Figures of invented results, by name, and the texts in a drawn figure."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from facets import POSE, Boundary
from facets.characterization import Index
from facets.core import RANGE_COLUMNS, STATE_COLUMNS


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def segment(name: str = "steps", count: int = 600, solved: bool = True) -> Any:
    """Make a motion of all axes with noise of its stated uncertainty and some unsolved samples."""
    random, time = rng(), np.arange(count) / 1000
    truth = np.zeros((count, 8))
    truth[:, :6] = np.sin(12 * time)[:, None] * [0.1, 0, 1, 2e-3, 0, 8e-3]
    sigma = np.tile([2e-3, 2e-3, 1e-3, 4e-6, 4e-6, 6e-6, 1e-3, 1e-3], (count, 1))
    state = truth + sigma * random.standard_normal(truth.shape)
    ok = np.full(count, solved)
    ok[count // 2 : count // 2 + 3] &= count < 10
    state[~ok] = np.nan
    told = np.where(ok[:, None], sigma, np.nan)
    solution = SimpleNamespace(state=state, uncertainty=told, converged=ok)
    error = (state - truth)[:, :6]
    return SimpleNamespace(name=name, time=time, truth=truth, solution=solution, error=error)


def motion(*segments: Any) -> Any:
    from facets.pictures import motion_picture

    return motion_picture(segments or [segment(), segment("a sweep with a long name", 90)])


def ranges(count: int = 15) -> Any:
    from facets.pictures import ranges_picture

    turn = np.linspace(0, 2 * np.pi, 49)[:-1]
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    causes = np.repeat([0, 1, 2, -1], 12)
    pairs = [(a, b) for n, a in enumerate(POSE) for b in POSE[n + 1 :]][:count]
    size = [6.0, 5.0, 12.0, 0.014, 0.012, 0.024]
    outlines = [Boundary(pair, np.zeros(6), circle * [size[POSE.index(n)] for n in pair], causes, 0)
                for pair in pairs]  # fmt: skip
    return ranges_picture(outlines)


def resolution() -> Any:
    from facets.pictures import budget_picture

    fine = np.array([2.4e-3, 2.4e-3, 1.5e-3, 4.2e-6, 4.2e-6, 6e-6])
    rows = []
    for name, size, share in (("paper: 8 readings", 1.0, 0.0), ("beam within 5 µm", 0.8, 0.18),
                              ("beam known", 0.03, 0.0)):  # fmt: skip
        shares = np.tile([1 - share, 0.0, share], (6, 1))
        rows.append(SimpleNamespace(how=SimpleNamespace(name=name), nominal=size * fine,
                                    worst=2 * size * fine, shares=shares,
                                    sources=("places", "powers", "beam position"),
                                    object=None))  # fmt: skip
    return budget_picture(rows)


def layout() -> Any:
    from facets.pictures import layout_picture

    fine = [f"u_{name.replace('_mm', '_um').replace('_mrad', '_urad')}" for name in STATE_COLUMNS]
    before = np.array([0.681, 0.66, 1.2, 3.8, 3.9, 6.1, 0.359, 0.39, 12.1, 28, 24.3, 49])
    after = np.array([0.466, 0.47, 0.9, 2.4, 2.4, 4.4, 0.355, 0.38, 11, 25, np.nan, 60])
    drawn = np.concatenate([after[:6] * 1.03, np.full(6, np.nan)])
    names = np.array([*fine[:6], *RANGE_COLUMNS])
    return layout_picture({"quantity": names, "before": before, "after": after, "simulated": drawn})


def designs(count: int = 300) -> dict[str, Any]:
    share = rng().random((count, 3))
    head = 150 + 400 * share[:, 0]
    fine = 4e3 / head * (1 + share[:, 1])
    reach = 20 + 30 * share[:, 2] - 8 * share[:, 1] + 0.03 * head
    reach[:40] = np.nan
    return {"head_mm": head, "u_roll_urad": fine, "range_roll_mrad": reach}


def front() -> Any:
    from facets.design import exploration
    from facets.pictures import front_picture

    table = designs()
    names = list(table)
    indices = {name: {key: Index(0.3, 0.08) for key in ("radius_mm", "pitch_mrad")}
               for name in names}  # fmt: skip
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

    random = rng()
    table = {
        "unit": np.array(["um"] * 3 + ["urad"] * 3), "before": np.geomspace(90, 1200, 6),
        "after": np.array([1.1, 1.2, 1.6, 4.4, 4.3, 6.2]), "stated": np.full(6, 1.5),
    }  # fmt: skip
    data = SimpleNamespace(raw=random.normal(0, 1.2, (400, 9)))
    return residual_picture(data, SimpleNamespace(left=random.normal(0, 1, (400, 9))), table)


def survey() -> Any:
    from facets.pictures import survey_picture

    counts = rng().poisson(3, (40, 40)).astype(float)
    edges = [np.linspace(0, 0.3, 41), np.linspace(-4e6, 4e6, 41), np.linspace(0, 2e-3, 41)]
    share = np.linspace(-0.1, 1.1, 50)
    pair = SimpleNamespace(share=share, apart=np.abs(np.sin(np.pi * share)),
                           determinant=1e5 * (0.5 - share))  # fmt: skip
    found = SimpleNamespace(counts=counts, second=counts, edges=edges)
    return survey_picture(found, "power_c", pair)


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


#: All figures by name.
ALL = {
    figure.__name__: figure
    for figure in (
        motion,
        ranges,
        resolution,
        layout,
        front,
        pareto,
        calibration,
        survey,
        spots,
        plan,
    )
}


def texts_of(picture: Any) -> list[tuple[Any, Any]]:
    """Draw a figure and return each text with its bounding box in pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.text import Text

    from facets.pictures import lay_out

    canvas = FigureCanvasAgg(picture)
    lay_out(picture, 100)
    found, plain = [], Text.draw

    def draw(self: Any, renderer: Any, *rest: Any, **options: Any) -> Any:
        if self.get_visible() and self.get_text().strip():
            found.append((self, Text.get_window_extent(self, renderer)))
        return plain(self, renderer, *rest, **options)

    Text.draw = draw
    try:
        canvas.draw()
    finally:
        Text.draw = plain
    return found
