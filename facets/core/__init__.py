from typing import TYPE_CHECKING

from .faces import load_on_use

if TYPE_CHECKING:
    from . import calibrate as calibrate
    from . import sensor as sensor
    from . import units as units
    from . import version as version
else:
    __getattr__ = load_on_use(__name__)
