"""Functions that shrink, enlarge and blur arrays of pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.units import Floats


def enlarge(picture: Any, size: tuple[int, int]) -> Any:
    """Resize a picture (h, w) or (h, w, c) to another width and height by linear interpolation."""
    from PIL import Image

    def one(channel: Any) -> Any:
        image = Image.fromarray(np.ascontiguousarray(channel, np.float32))
        return np.asarray(image.resize(size, Image.Resampling.BILINEAR))

    if picture.ndim == 2:
        return one(picture)
    return np.stack([one(picture[..., n]) for n in range(picture.shape[2])], axis=-1)


def reduce_size(picture: Any, step: int) -> Any:
    """Average step x step pixels; excess pixels at the right and below are dropped."""
    height, width = (n // step * step for n in picture.shape[:2])
    rows = sum(picture[n:height:step] for n in range(step))
    return sum(rows[:, n:width:step] for n in range(step)) / step**2


def halo(light: Any, share: float, least: float = 0.0) -> Any:
    """Blur light as a lens does; share: of the picture's height, with a least number of pixels.

    The blur is computed on a part of the pixels, since its result has no finer detail.
    """
    from scipy.ndimage import gaussian_filter

    height, width = light.shape[:2]
    share = max(share, least / height)
    step = 4 if share * height > 6 else 2
    padded = np.pad(light, ((0, -height % step), (0, -width % step), (0, 0))[: light.ndim])
    sigma = share * height / step
    soft = gaussian_filter(reduce_size(padded, step), (sigma, sigma, 0)[: light.ndim], truncate=3)
    return enlarge(soft, (padded.shape[1], padded.shape[0]))[:height, :width]


def as_bytes(picture: Floats) -> Any:
    """Convert shares to bytes, 0 to 255."""
    return (255 * np.clip(picture, 0, 1) + 0.5).astype(np.uint8)
