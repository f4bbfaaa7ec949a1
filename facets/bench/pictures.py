"""The picture of `facets bench`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..pictures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = dict[str, Any]


def heat_map(rows: Sequence[Row]) -> Figure:
    """Draw the digits of power and position over apex offset and tilt."""
    offsets = sorted({row["offset_sigma"] for row in rows})
    tilts = sorted({row["tilt_mrad"] for row in rows})
    with style.style_context(axes__grid=False):
        picture = style.figure(style.FULL, 3.2)
        panels = picture.subplots(1, 2, sharey=True)
        for axes, key, title in zip(
            panels, ("power_error", "place_error_mm"),
            ("relative error of a power", "error of a place, mm"), strict=True,
        ):  # fmt: skip
            values = {(r["tilt_mrad"], r["offset_sigma"]): r[key] for r in rows}
            grid = np.array([[values[tilt, offset] for offset in offsets] for tilt in tilts])
            image = axes.imshow(
                np.log10(np.maximum(grid, 1e-17)),
                origin="lower", aspect="auto", cmap="viridis", vmin=-17, vmax=-11,
            )  # fmt: skip
            some = slice(None, None, max(1, -(-len(offsets) // 6)))
            axes.set_xticks(range(len(offsets))[some], [f"{x:g}" for x in offsets[some]])
            axes.set_yticks(range(len(tilts)), [f"{tilt:g}" for tilt in tilts])
            axes.set(xlabel="apex offset, sigmas of the beam", title=title)
        panels[0].set_ylabel("tilt, mrad")
        bar = picture.colorbar(image, ax=panels, pad=0.02, aspect=28, extend="both")
        bar.set_label("error, power of ten")
        bar.outline.set_visible(False)
    return picture
