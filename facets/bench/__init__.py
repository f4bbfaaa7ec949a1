"""Run time against error, beside what a user would write without this package."""

from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import peers as peers
    from . import pictures as pictures
else:
    __getattr__ = load_on_use(__name__)
