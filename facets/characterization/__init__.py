from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import ambiguity as ambiguity
    from . import axis_report as axis_report
    from . import axis_visits as axis_visits
    from . import frequency_response as frequency_response
    from . import noise_report as noise_report
    from . import outlines as outlines
    from . import propagation as propagation
    from . import random_poses as random_poses
    from . import ranges as ranges
    from . import resolution as resolution
    from . import response_findings as response_findings
    from . import response_signals as response_signals
    from . import rest as rest
    from . import sensitivity as sensitivity
    from . import singularity as singularity
    from . import state_box as state_box
    from . import tables as tables
    from . import trials as trials
    from . import universal_file as universal_file
else:
    __getattr__ = load_on_use(__name__)
