"""YAML configurations: keys with units, defaults, ranges, and errors with file and line."""

from ..core.axis_keys import State
from ..core.motions import Motion, Random, Sine, Steps, Sweep, Table
from ..core.settings import Config, Solve
from .files import shipped
from .json_schema import schema
from .loading import fingerprint, load
from .show import to_yaml

__all__ = [
    "Config",
    "Motion",
    "Random",
    "Sine",
    "Solve",
    "State",
    "Steps",
    "Sweep",
    "Table",
    "fingerprint",
    "load",
    "schema",
    "shipped",
    "to_yaml",
]
