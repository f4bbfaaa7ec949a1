"""Run time and error of facets, compared with code that a user would write without it."""

from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import rivals as rivals, table as table
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "clock": "Contender cpu_seconds",
            "rivals": "has_compiler",
            "table": "pose_ways reading_ways slower_rows",
        },
    )
