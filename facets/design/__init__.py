from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import assembly as assembly
    from . import branching as branching
    from . import changes as changes
    from . import exploration as exploration
    from . import front as front
    from . import gallery as gallery
    from . import production as production
    from . import report as report
    from . import robust as robust
    from . import rounding as rounding
    from . import search as search
    from . import sheets as sheets
    from . import survey as survey
    from . import tables as tables
    from . import tolerancing as tolerancing
    from . import variables as variables
    from . import verification as verification
else:
    __getattr__ = load_on_use(__name__)
