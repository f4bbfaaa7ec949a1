from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import calibration as calibration
    from . import film as film
    from . import magnification as magnification
    from . import materials as materials
    from . import motion as motion
    from . import noise as noise
    from . import page as page
    from . import ranges as ranges
    from . import render as render
    from . import resolution as resolution
    from . import singularity as singularity
    from . import spots as spots
    from . import style as style
else:
    __getattr__ = load_on_use(__name__)
