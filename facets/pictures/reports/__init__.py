"""Pages of sentences, tables and drawings on a result, and the words in them."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if not TYPE_CHECKING:
    __getattr__ = load_on_use(__name__)
