"""YAML configurations: keys with units, defaults, ranges, and errors with file and line."""

from typing import TYPE_CHECKING

from ..core.faces import load_on_use

_NAMES_OF = {
    ".core.settings": "Config Solve",
    ".core.motions": "Motion Random Runs Sine Steps Sweep Table Vibration",
    ".core.axis_keys": "State",
    "loading": "fingerprint load source_files",
    "json_schema": "key_names schema",
    "checks": "ValueCheck",
    "nodes": "block_node",
    "shipped_files": "purpose shipped",
    "show": "to_yaml",
    "sensor_keys": "write_sensor",
}
__all__ = sorted(" ".join(_NAMES_OF.values()).split())

if TYPE_CHECKING:
    from ..core.axis_keys import State as State
    from ..core.motions import (
        Motion as Motion,
        Random as Random,
        Runs as Runs,
        Sine as Sine,
        Steps as Steps,
        Sweep as Sweep,
        Table as Table,
        Vibration as Vibration,
    )
    from ..core.settings import Config as Config, Solve as Solve
    from . import (
        build as build,
        covariance as covariance,
        files as files,
        grid as grid,
        sensor_keys as sensor_keys,
    )
    from .json_schema import schema as schema
    from .loading import fingerprint as fingerprint, load as load, source_files as source_files
    from .shipped_files import purpose as purpose, shipped as shipped
    from .show import to_yaml as to_yaml
else:
    __getattr__ = load_on_use(__name__, _NAMES_OF)
