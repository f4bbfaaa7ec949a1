"""Heads with the tolerances of their parts: their yield, and layouts that leave them room."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import heads as heads, prediction as prediction, robust as robust
else:
    __getattr__ = load_on_use(__name__)
