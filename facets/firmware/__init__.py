from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import export as export, library as library, source as source
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "library": "FirmwareLibrary",
        },
    )
