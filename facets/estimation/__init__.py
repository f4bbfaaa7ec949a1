from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import coverage as coverage
    from . import solution as solution
    from . import table as table
    from . import zero as zero
else:
    __getattr__ = load_on_use(__name__)
