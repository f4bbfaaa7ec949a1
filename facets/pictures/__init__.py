from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import axis as axis
    from . import calibration as calibration
    from . import calibration_certificate as calibration_certificate
    from . import exploration as exploration
    from . import exploration_page as exploration_page
    from . import film as film
    from . import head_drawing as head_drawing
    from . import layout as layout
    from . import magnification as magnification
    from . import materials as materials
    from . import motion as motion
    from . import noise as noise
    from . import page as page
    from . import ranges as ranges
    from . import render as render
    from . import report_page as report_page
    from . import resolution as resolution
    from . import response as response
    from . import singularity as singularity
    from . import spots as spots
    from . import style as style
    from . import trials as trials
    from . import wording as wording
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "glow": "sub_beam surface",
            "magnification": "motion_factor",
            "motion": "motion_picture",
            "page.rig_page": "rig_page",
            "render": "Picture",
            "scene": "Stand",
            "spots": "light_on plan_picture",
            "style": "lay_out",
            "views": "face_camera",
        },
    )
