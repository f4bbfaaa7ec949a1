"""From blocks of bytes to poses: the loop, the solving, and the views."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import pipeline as pipeline
else:
    __getattr__ = load_on_use(__name__)
