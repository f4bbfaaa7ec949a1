"""Docstrings as pages show them: what each argument is as a list, examples as code.

The code's docstrings are plain text: a paragraph such as `states: (n, 8).  how: what is known.`
tells what arguments or fields are, and a paragraph that begins with `>>>` is an example.
"""

from __future__ import annotations

import re
from typing import Any

import griffe

NAMES = r"[a-z_]\w*(?:, [a-z_]\w*)*"
#: Where an explanation begins: at a line, or after two spaces behind a full stop.
BEGIN = re.compile(rf"(?:^|\n|(?<=[.;])  )(?=(?:{NAMES}): )|(?<=[.;])\s+(?=Returns |Raises )")


def shown(text: str) -> str:
    """A docstring in Markdown."""
    return "\n\n".join(paragraph(part) for part in text.split("\n\n"))


def paragraph(part: str) -> str:
    if part.lstrip().startswith(">>>"):
        lines = [line.strip() if ">>>" in line else line for line in part.strip().splitlines()]
        return "\n".join(["```pycon", *lines, "```"])
    if not re.match(rf"{NAMES}: ", part):
        return part
    told = [" ".join(item.split()) for item in BEGIN.split(part) if item.strip()]
    return "\n".join("- " + re.sub(rf"^({NAMES}): ", r"`\1`: ", item) for item in told)


class Docstrings(griffe.Extension):
    """Changes each docstring as it is collected."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = shown(obj.docstring.value)
