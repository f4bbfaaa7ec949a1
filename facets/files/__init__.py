from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import provenance as provenance
    from . import tables as tables
    from . import whole as whole
else:
    __getattr__ = load_on_use(__name__)
