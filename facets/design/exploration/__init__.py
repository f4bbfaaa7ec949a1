"""A design space: measures of its designs, runs that sample it, and its Pareto front."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import front as front, gallery as gallery, runs as runs, space as space
    from .runs import explore as explore
else:
    __getattr__ = load_on_use(__name__, {"runs": "explore"})
