"""What the commands say to a person."""

from __future__ import annotations

from facets.core.errors import FacetsError


def message(error: FacetsError) -> str:
    """`error: ...`, further lines set below the first."""
    return "error: " + str(error).replace("\n", "\n       ")
