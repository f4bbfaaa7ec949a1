"""facets: a three-facet-mirror 6-DOF sensor, from its design to its live readings.

    >>> import facets
    >>> sensor = facets.load("paper").sensor
    >>> reading = facets.readings(sensor, [0.01, 0, 0, 0, 0, 0.001, 0, 0])
    >>> solution = facets.solve(sensor, reading)
    >>> bool(solution.ok), f"{1e3 * solution.state[5]:.3f} mrad of yaw"
    (True, '1.000 mrad of yaw')

Lengths mm, angles rad, powers mW, time s. Arrays put components last.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# A name is imported when it is first asked for, so that a command pays only for what it uses.
_HOMES = {
    "Apertures": "sensor",
    "Beam": "sensor",
    "Electronics": "sensor",
    "Facet": "sensor",
    "Noise": "sensor",
    "PARAMETERS": "optics.parameters",
    "Prior": "solver",
    "Psd": "sensor",
    "READING": "names",
    "STATE": "names",
    "Sensor": "sensor",
    "Solution": "solver",
    "Status": "solver",
    "footprints": "model",
    "jacobian": "model",
    "load": "config",
    "margins": "model",
    "parameter_jacobian": "model",
    "reaches": "model",
    "readings": "model",
    "solve": "solver",
}
__all__ = sorted(_HOMES)

if TYPE_CHECKING:
    from .config import load as load
    from .model import footprints as footprints
    from .model import jacobian as jacobian
    from .model import margins as margins
    from .model import parameter_jacobian as parameter_jacobian
    from .model import reaches as reaches
    from .model import readings as readings
    from .names import READING as READING
    from .names import STATE as STATE
    from .optics.parameters import PARAMETERS as PARAMETERS
    from .sensor import Apertures as Apertures
    from .sensor import Beam as Beam
    from .sensor import Electronics as Electronics
    from .sensor import Facet as Facet
    from .sensor import Noise as Noise
    from .sensor import Psd as Psd
    from .sensor import Sensor as Sensor
    from .solver import Prior as Prior
    from .solver import Solution as Solution
    from .solver import Status as Status
    from .solver import solve as solve


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'facets' has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*globals(), *_HOMES]
