"""Samples of a run that are published for other programs."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if TYPE_CHECKING:
    from . import mcap_file as mcap_file, publication as publication, sample_rows as sample_rows
else:
    __getattr__ = load_on_use(__name__)
