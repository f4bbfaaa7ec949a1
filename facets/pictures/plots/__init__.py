"""Plots by Matplotlib, a file for each result."""

from typing import TYPE_CHECKING

from ...core.faces import load_on_use

if not TYPE_CHECKING:
    __getattr__ = load_on_use(__name__)
