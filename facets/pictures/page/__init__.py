from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import rig_page as rig_page, scripts as scripts
else:
    __getattr__ = load_on_use(__name__)
