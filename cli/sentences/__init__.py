"""The texts, tables and pages of results that commands print."""

from typing import TYPE_CHECKING

from facets.core.faces import load_on_use

if TYPE_CHECKING:
    from . import bounds as bounds, certificate as certificate
else:
    __getattr__ = load_on_use(__name__)
