from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import exploration as exploration
else:
    __getattr__ = load_on_use(__name__)
