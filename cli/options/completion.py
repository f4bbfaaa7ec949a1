"""Completions for a shell: configurations, their motions, keys and other names."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import typer

from facets import config as configuration, core, design
from facets.core.errors import FacetsError
from facets.core.names import STATE_COLUMNS


def configurations(incomplete: str) -> Iterator[str]:
    """Complete the shipped configurations, and the paths of YAML files and folders."""
    yield from (name for name in configuration.shipped() if name.startswith(incomplete))
    folder, slash, start = incomplete.rpartition("/")
    for path in sorted(Path(f"{folder}{slash}").glob(f"{glob.escape(start)}*")):
        if path.is_dir() or path.suffix in (".yaml", ".yml"):
            yield f"{folder}{slash}{path.name}{'/' * path.is_dir()}"


def motions(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete the motions of the configuration that was typed before."""
    name = ctx.params.get("config") or next(iter(ctx.args), "")  # before an option without a value
    try:
        names = configuration.load(name).motions
    except FacetsError:
        return []
    return [name for name in names if name.startswith(incomplete)]


def assignments(
    names: Callable[[], Sequence[str]], values: Sequence[str] = ("",)
) -> Callable[[str], list[str]]:
    """Complete `NAME=VALUE,...`: the remaining names, each with its possible values."""

    def complete(incomplete: str) -> list[str]:
        before, comma, start = incomplete.rpartition(",")
        typed = [assignment.partition("=")[0] for assignment in before.split(",")]
        offered = [f"{name}={value}" for name in names() if name not in typed for value in values]
        return [f"{before}{comma}{word}" for word in offered if word.startswith(start)]

    return complete


def words(names: Callable[[], Sequence[str]]) -> Callable[[str], list[str]]:
    """Complete one of some names."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


def state_names() -> Sequence[str]:
    return STATE_COLUMNS


def effects() -> Sequence[str]:
    return [key.name for key in core.calibrate.EFFECTS.keys]


def measures() -> Sequence[str]:
    return design.exploration.space.MEASURES


def experiments() -> Sequence[str]:
    from facets.experiments.paper.experiment import EXPERIMENTS

    return list(EXPERIMENTS)
