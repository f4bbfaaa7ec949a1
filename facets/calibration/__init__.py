from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import budget as budget
    from . import identifiability as identifiability
    from . import proposal as proposal
    from . import reference_join as reference_join
    from . import rezero as rezero
    from . import table as table
    from . import tour as tour
    from . import unknowns as unknowns
    from . import verdict as verdict
else:
    __getattr__ = load_on_use(__name__)
