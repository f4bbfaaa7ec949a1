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

from .core.version import __version__ as __version__

# A name is imported when it is first asked for, so that a command pays only for what it uses.
_HOMES = {
    "Apertures": "core.sensor",
    "Beam": "core.sensor",
    "Electronics": "core.sensor",
    "Facet": "core.sensor",
    "Noise": "core.sensor",
    "PARAMETERS": "optics.parameters",
    "Prior": "estimation.solver",
    "Psd": "core.sensor",
    "READING": "core.names",
    "STATE": "core.names",
    "Sensor": "core.sensor",
    "Solution": "estimation.solver",
    "Solver": "estimation.prepared",
    "Status": "estimation.solver",
    "footprints": "model.arrays",
    "jacobian": "model.arrays",
    "load": "config",
    "margins": "model.arrays",
    "parameter_jacobian": "model.arrays",
    "reaches": "model.arrays",
    "readings": "model.arrays",
    "solve": "estimation.solver",
}
__all__ = sorted(_HOMES)

if TYPE_CHECKING:
    from .config import load as load
    from .core.names import READING as READING
    from .core.names import STATE as STATE
    from .core.sensor import Apertures as Apertures
    from .core.sensor import Beam as Beam
    from .core.sensor import Electronics as Electronics
    from .core.sensor import Facet as Facet
    from .core.sensor import Noise as Noise
    from .core.sensor import Psd as Psd
    from .core.sensor import Sensor as Sensor
    from .estimation.prepared import Solver as Solver
    from .estimation.solver import Prior as Prior
    from .estimation.solver import Solution as Solution
    from .estimation.solver import Status as Status
    from .estimation.solver import solve as solve
    from .model.arrays import footprints as footprints
    from .model.arrays import jacobian as jacobian
    from .model.arrays import margins as margins
    from .model.arrays import parameter_jacobian as parameter_jacobian
    from .model.arrays import reaches as reaches
    from .model.arrays import readings as readings
    from .optics.parameters import PARAMETERS as PARAMETERS


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'facets' has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*globals(), *_HOMES]
