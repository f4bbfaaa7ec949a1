"""YAML configurations: keys with units, defaults, ranges, and errors with file and line."""

from typing import TYPE_CHECKING

from ..core.faces import load_on_use

_HOMES = {
    "Config": ".core.settings",
    "Motion": ".core.motions",
    "Random": ".core.motions",
    "Runs": ".core.motions",
    "Sine": ".core.motions",
    "Solve": ".core.settings",
    "State": ".core.axis_keys",
    "Steps": ".core.motions",
    "Sweep": ".core.motions",
    "Table": ".core.motions",
    "Vibration": ".core.motions",
    "fingerprint": "loading",
    "load": "loading",
    "schema": "json_schema",
    "shipped": "files",
    "source_files": "loading",
    "to_yaml": "show",
}
__all__ = sorted(_HOMES)

if TYPE_CHECKING:
    from ..core.axis_keys import State as State
    from ..core.motions import Motion as Motion
    from ..core.motions import Random as Random
    from ..core.motions import Runs as Runs
    from ..core.motions import Sine as Sine
    from ..core.motions import Steps as Steps
    from ..core.motions import Sweep as Sweep
    from ..core.motions import Table as Table
    from ..core.motions import Vibration as Vibration
    from ..core.settings import Config as Config
    from ..core.settings import Solve as Solve
    from . import covariance as covariance
    from . import files as files
    from . import grid as grid
    from . import sensor_keys as sensor_keys
    from .files import shipped as shipped
    from .json_schema import schema as schema
    from .loading import fingerprint as fingerprint
    from .loading import load as load
    from .loading import source_files as source_files
    from .show import to_yaml as to_yaml
else:
    __getattr__ = load_on_use(__name__, _HOMES)
