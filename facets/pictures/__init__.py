"""Pictures of a sensor and of results: plots, stills, pages of results, and the page of a rig."""

from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import page as page
    from . import style as style
    from .plots import axis as axis
    from .plots import calibration as calibration
    from .plots import exploration as exploration
    from .plots import layout as layout
    from .plots import motion as motion
    from .plots import noise as noise
    from .plots import ranges as ranges
    from .plots import resolution as resolution
    from .plots import response as response
    from .plots import singularity as singularity
    from .plots import spots as spots
    from .plots import trials as trials
    from .reports import calibration_certificate as calibration_certificate
    from .reports import exploration_page as exploration_page
    from .reports import head_drawing as head_drawing
    from .reports import report_page as report_page
    from .reports import wording as wording
    from .stills import materials as materials
    from .stills import render as render
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
            "stills.scene": "Stand",
            "stills.views": "RigView",
            "style": "lay_out",
        },
    )
