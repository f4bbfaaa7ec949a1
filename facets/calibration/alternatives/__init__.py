"""What else could explain a fit's residuals: one list, one score, and which of it may be named."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import alternative as alternative, faults as faults, scatter as scatter
else:
    __getattr__ = load_on_use(__name__)
