"""Fit a rig's parameters and the unknowns of each sample to readings with a reference."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import fit as fit, unknowns as unknowns
else:
    __getattr__ = load_on_use(__name__)
