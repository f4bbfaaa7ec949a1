from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import arrays as arrays
    from . import rare as rare
    from . import threads as threads
else:
    __getattr__ = load_on_use(__name__)
