from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import axis_runs as axis_runs
    from . import motion as motion
    from . import run as run
else:
    __getattr__ = load_on_use(__name__)
