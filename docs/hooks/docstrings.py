"""Docstrings as pages show them: what each argument is as a list, examples as code.

The code's docstrings are plain text: a paragraph such as `states: (n, 8).  how: what is known.`
tells what arguments or fields are, and a paragraph that begins with `>>>` is an example.
"""

from __future__ import annotations

import dataclasses
import importlib
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


def default_of(kind: str, name: str) -> str | None:
    """The default of a dataclass's field that a key of configurations gives, else None."""
    module, _, last = kind.rpartition(".")
    owner = getattr(importlib.import_module(module), last, None)
    for one in dataclasses.fields(owner) if dataclasses.is_dataclass(owner) else ():
        if one.name == name and "source" in one.metadata:
            return repr(one.default)
    return None


class Docstrings(griffe.Extension):
    """Changes each docstring as it is collected, and shows defaults instead of declared keys."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = shown(obj.docstring.value)

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_: Any) -> None:
        is_field = attr.parent is not None and attr.parent.is_class
        if is_field and isinstance(attr.value, griffe.ExprCall):
            attr.value = default_of(attr.parent.path, attr.name) or attr.value
