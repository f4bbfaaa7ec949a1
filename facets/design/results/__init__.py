"""A design that was found: its configuration, its tables, and its comparison with the present."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import changes as changes, tables as tables, verification as verification
else:
    __getattr__ = load_on_use(__name__)
