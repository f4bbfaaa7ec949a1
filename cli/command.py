"""Parsing of a command's arguments: refusal of odd values."""

from __future__ import annotations

import re
from math import isfinite
from typing import Any

import typer
from typer.core import TyperCommand

from facets.core.plain_numbers import plain_number

#: Options whose value may be left out: its default then, and the pattern of a value.
OPTIONAL_VALUES = {"--web": ("0", r"[^-].*"), "--certify": ("20000", r"-?[\d.+e_]+")}


class Command(TyperCommand):
    """A command that refuses option values without a meaning.

    It refuses an empty value, the same value twice, another option's name, and a number that is
    infinite or has underscores. The values of OPTIONAL_VALUES may be left out.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        add_optional_values(args)
        typed, _, _ = self.make_parser(ctx).parse_args(args=list(args))
        rest: list[str] = super().parse_args(ctx, args)
        params: list[Any] = self.get_params(ctx)
        names = [name for param in params for name in (*param.opts, *param.secondary_opts)]
        options = {name for name in names if name.startswith("-")}  # not the values of arguments
        for param in params:
            value = typed.get(param.name)
            texts = value if isinstance(value, list | tuple) else [value]
            is_number = isinstance(ctx.params.get(param.name), int | float)
            if reason := why_meaningless(
                [t for t in texts if isinstance(t, str)], is_number, options
            ):
                raise typer.BadParameter(reason, ctx=ctx, param=param)
        return rest


def add_optional_values(args: list[str]) -> None:
    """Write the value after each option of OPTIONAL_VALUES that stands without one."""
    for n, text in enumerate(args):
        if text in OPTIONAL_VALUES:
            default, form = OPTIONAL_VALUES[text]
            if not re.fullmatch(form, "".join(args[n + 1 : n + 2])):
                args[n] = f"{text}={default}"


def why_meaningless(texts: list[str], is_number: bool, options: set[str]) -> str:
    """Reason why the typed values of an option have no meaning; "" if they have one."""
    for n, text in enumerate(texts):
        if not text.strip():
            return "the value is empty; give a value, or leave the option out"
        if text in options:
            return f"a value must stand before the option {text}"
        if text in texts[:n]:
            return f"{text} is given twice"
        if is_number and is_odd_number(text):
            return f"{text!r} is not a plain finite number"
    return ""


def is_odd_number(text: str) -> bool:
    """Return whether Python reads the text as a number that a person would not have typed."""
    try:
        float(text)
    except ValueError:
        return False
    try:
        return not isfinite(plain_number(text))
    except ValueError:
        return True
