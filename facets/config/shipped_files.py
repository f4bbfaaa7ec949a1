"""The configurations that come with the package."""

from __future__ import annotations

import re
from pathlib import Path


def shipped() -> dict[str, Path]:
    """Paths of the configurations that come with the package, by name."""
    installed = Path(__file__).parents[1] / "configs"
    in_source_tree = Path(__file__).parents[2] / "configs"
    folder = installed if installed.is_dir() else in_source_tree
    return {file.stem: file for file in sorted(folder.glob("*.yaml"), key=lambda file: file.stem)}


def purpose(name: str) -> str:
    """The first sentence of the comment at the head of a shipped configuration."""
    head = re.match(r"(?:# .*\n)*", shipped()[name].read_text("utf-8"))
    lines = head[0].splitlines() if head else []
    words = " ".join(line[2:] for line in lines if not line.startswith("#   "))
    return re.split(r"(?<=[^A-Z.][.?]) (?=[A-Z])", words)[0]
