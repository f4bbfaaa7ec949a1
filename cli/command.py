"""Parsing of a command's arguments: messages about old spellings, refusal of odd values."""

from __future__ import annotations

import re
from math import isfinite
from typing import Any

import typer
from typer.core import TyperCommand

from facets.core.plain_numbers import plain_number

#: Options whose value may be left out: its default then, and the pattern of a value.
OPTIONAL_VALUES = {"--web": ("0", r"[^-].*"), "--certify": ("20000", r"-?[\d.+e_]+")}

#: Commands whose result is a folder, for which -o is often typed.
FOLDER_COMMANDS = (
    "simulate", "range-map", "resolution", "jacobian", "tolerances", "acquire", "noise", "export-c",
    "bench", "reproduce",
)  # fmt: skip
#: What to give instead of an option that a command does not have.
RENAMED = {(name, option): "--folder" for name in FOLDER_COMMANDS for option in ("-o", "--output")}


class Command(TyperCommand):
    """A command that refuses option values without a meaning, and names new spellings for old ones.

    It refuses an empty value, the same value twice, another option's name, and a number that is
    infinite or has underscores. The values of OPTIONAL_VALUES may be left out.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        add_optional_values(args)
        if reason := name_new_spelling(ctx.info_name, args):
            raise typer.BadParameter(reason, ctx=ctx)
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


def name_new_spelling(command: str, args: list[str]) -> str:
    """The message about the first option with an old spelling; "" if there is none."""
    for text in args:
        option = text.partition("=")[0]
        new = RENAMED.get((command, option))
        if new is not None:
            return f"{option} is now {new}; see `facets {command} --help`"
    return ""


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
