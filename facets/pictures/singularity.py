"""Pictures of how regular the Jacobian is: Fig. 4, and where it fails."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..characterization.ambiguity import AmbiguousPair
from ..characterization.singularity import Survey
from ..core.units import Floats
from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def survey_picture(found: Survey, left_out: str, pair: AmbiguousPair | None = None) -> Figure:
    """Determinant (as Fig. 4) and smallest singular value against the apex's offset.

    pair: two states with the same readings, where there are any.
    """
    with style.in_rules():
        picture = style.figure(8.4, 3.6 if pair is None else 6.6)
        panels = picture.subplots(1 if pair is None else 2, 2, squeeze=False)
        density(picture, panels[0, 0], found.edges[0], found.edges[1], found.counts)
        panels[0, 0].set(
            xlabel="apex from the beam's centre, mm",
            ylabel="determinant, mm, mW, rad",
            title=f"Eq. (11), without {left_out}",
        )
        density(picture, panels[0, 1], found.edges[0], found.edges[2], found.second)
        panels[0, 1].set(
            xlabel="apex from the beam's centre, mm",
            ylabel="standard deviations per µm or µrad",
            title="smallest singular value",
        )
        if pair is not None:
            between_twins(panels[1], pair)
    return picture


def density(picture: Figure, panel: Axes, x: Floats, y: Floats, counts: Floats) -> None:
    """How many states fall where; white where none."""
    from matplotlib.colors import LogNorm

    shown = np.ma.masked_equal(counts.T, 0)
    image = panel.pcolormesh(x, y, shown, norm=LogNorm(vmin=1), cmap="viridis", rasterized=True)
    panel.axhline(0, color=style.ORANGE, lw=1)
    picture.colorbar(image, ax=panel, label="states")


def between_twins(panels: NDArray[np.object_], pair: AmbiguousPair) -> None:
    """Along the line from one to the other: readings part and meet again where the sign changes."""
    first, second = panels
    first.plot(pair.share, pair.apart, color=style.BLUE)
    first.plot([0, 1], [0, 0], "o", color=style.ORANGE)
    first.set(
        xlabel="from one state (0) to its twin (1)",
        ylabel="readings apart, standard deviations",
        title="two states, the same readings",
    )
    second.plot(pair.share, pair.determinant, color=style.BLUE)
    second.axhline(0, color=style.ORANGE, lw=1)
    second.set(
        xlabel="from one state (0) to its twin (1)",
        ylabel="determinant, mm, mW, rad",
        title="between them its sign changes",
    )
