"""The search for the best layout over a volume, and for the best parts of a catalogue."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import parts as parts, rounding as rounding, search as search
else:
    __getattr__ = load_on_use(__name__)
