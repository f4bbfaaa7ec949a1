"""Pictures of a sensor and of results: plots, stills, pages of results, and the page of a rig."""

from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import page as page, style as style
    from .plots import (
        axis as axis,
        calibration as calibration,
        exploration as exploration,
        layout as layout,
        motion as motion,
        noise as noise,
        ranges as ranges,
        resolution as resolution,
        response as response,
        singularity as singularity,
        spots as spots,
        trials as trials,
    )
    from .reports import (
        calibration_certificate as calibration_certificate,
        exploration_page as exploration_page,
        head_drawing as head_drawing,
        report_page as report_page,
        wording as wording,
    )
    from .stills import materials as materials, render as render
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "page.rig_page": "rig_page",
            "plots": (
                "axis calibration exploration layout motion noise ranges resolution response "
                "singularity spots trials"
            ),
            "plots.motion": "motion_picture",
            "plots.ranges": "ranges_picture",
            "plots.spots": "light_on plan_picture spots_picture",
            "reports": "calibration_certificate exploration_page head_drawing report_page wording",
            "stills": "materials range_solid render scene",
            "stills.glow": "sub_beam surface",
            "stills.render": "Picture PictureForm motion_factor",
            "stills.rig": "RigModel",
            "stills.scene": "PosedSensor",
            "stills.views": "RigView",
            "style": "lay_out",
        },
    )
