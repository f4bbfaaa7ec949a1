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

from typing import TYPE_CHECKING

from .core.faces import load_on_use
from .core.version import __version__ as __version__

# A name is imported at its first use, so that a command loads only what it needs.
_NAMES_OF = {
    "config.loading": "load",
    "core.errors": "ConfigError FacetsError InputError OutputError",
    "core.knowledge": "Knowledge Prior",
    "core.names": "POSE READING STATE",
    "core.rigid_body": "MeasuredObject",
    "core.rules": "Rules",
    "core.sensor": (
        "Apertures Beam BenchLight Calibration Correction Electronics Facet Grid Noise Psd Sensor"
    ),
    "core.settings": "Config",
    "optics.forward": "PARAMETERS",
    "model.arrays": "footprints jacobian margins parameter_jacobian reaches readings",
    "detectors.noise": "add_noise standard_deviations",
    "estimation.measurement": "Measurement",
    "estimation.zero": "PoseColumns ZeroPose ZeroRequest zero_pose",
    "estimation.solution": "Poses Samples Solution Status",
    "estimation.solver": "Solver solve",
    "estimation.differences": "difference_uncertainty mean_uncertainty",
    "estimation.object_pose": "ObjectPose transform",
    "estimation.uncertainty": "unseen_errors",
    "axis_tests.report": "measure_axis",
    "responses.signals": "measure_response",
    "characterization.ranges": "AxisRange CAUSES axis_ranges",
    "characterization.outlines": "Boundary trace",
    "characterization.resolution": "Estimator budgets uncertainties",
    "files.frame_table": "to_sep005 to_xarray",
    "live.recording.data_frame": "read_table",
    "simulation.run": "Segment simulate",
    "design.optimisation.search": "Optimum optimize",
}
__all__ = sorted(" ".join(_NAMES_OF.values()).split())

if TYPE_CHECKING:
    from .axis_tests.report import measure_axis as measure_axis
    from .characterization.outlines import Boundary as Boundary, trace as trace
    from .characterization.ranges import (
        CAUSES as CAUSES,
        AxisRange as AxisRange,
        axis_ranges as axis_ranges,
    )
    from .characterization.resolution import (
        Estimator as Estimator,
        budgets as budgets,
        uncertainties as uncertainties,
    )
    from .config.loading import load as load
    from .core.errors import (
        ConfigError as ConfigError,
        FacetsError as FacetsError,
        InputError as InputError,
        OutputError as OutputError,
    )
    from .core.knowledge import Knowledge as Knowledge, Prior as Prior
    from .core.names import POSE as POSE, READING as READING, STATE as STATE
    from .core.rigid_body import MeasuredObject as MeasuredObject
    from .core.rules import Rules as Rules
    from .core.sensor import (
        Apertures as Apertures,
        Beam as Beam,
        BenchLight as BenchLight,
        Calibration as Calibration,
        Correction as Correction,
        Electronics as Electronics,
        Facet as Facet,
        Grid as Grid,
        Noise as Noise,
        Psd as Psd,
        Sensor as Sensor,
    )
    from .core.settings import Config as Config
    from .design.optimisation.search import Optimum as Optimum, optimize as optimize
    from .detectors.noise import add_noise as add_noise, standard_deviations as standard_deviations
    from .estimation.differences import (
        difference_uncertainty as difference_uncertainty,
        mean_uncertainty as mean_uncertainty,
    )
    from .estimation.measurement import Measurement as Measurement
    from .estimation.object_pose import ObjectPose as ObjectPose, transform as transform
    from .estimation.solution import (
        Poses as Poses,
        Samples as Samples,
        Solution as Solution,
        Status as Status,
    )
    from .estimation.solver import Solver as Solver, solve as solve
    from .estimation.uncertainty import unseen_errors as unseen_errors
    from .estimation.zero import (
        PoseColumns as PoseColumns,
        ZeroPose as ZeroPose,
        ZeroRequest as ZeroRequest,
        zero_pose as zero_pose,
    )
    from .files.frame_table import to_sep005 as to_sep005, to_xarray as to_xarray
    from .live.recording.data_frame import read_table as read_table
    from .model.arrays import (
        footprints as footprints,
        jacobian as jacobian,
        margins as margins,
        parameter_jacobian as parameter_jacobian,
        reaches as reaches,
        readings as readings,
    )
    from .optics.forward import PARAMETERS as PARAMETERS
    from .responses.signals import measure_response as measure_response
    from .simulation.run import Segment as Segment, simulate as simulate
else:
    __getattr__ = load_on_use(__name__, _NAMES_OF)


def __dir__() -> list[str]:
    return __all__
