"""Parsing of a command's arguments: refusal of odd values."""

from __future__ import annotations

import re
from contextlib import suppress
from enum import Enum
from math import inf, isfinite
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from facets.core.plain_numbers import plain_number

#: Options whose value may be left out: its default then, and the pattern of a value.
OPTIONAL_VALUES = {"--web": ("0", r"[^-].*"), "--certify": ("20000", r"-?[\d.+e_]+")}


class PlainParameters:
    """Commands whose parameters are converted by `Conversion`."""

    def get_params(self, ctx: Any) -> list[Any]:
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for param in params:
            # an earlier typer converts without pydantic
            if hasattr(param, "get_runtime_param") and "get_runtime_param" not in vars(param):
                Conversion(param)
        return params


class Group(PlainParameters, TyperGroup):
    """A group of commands."""


class PlainCommand(PlainParameters, TyperCommand):
    """A command that takes values as they are."""


class Command(PlainCommand):
    """A command that refuses option values without a meaning.

    It refuses an empty value, the same value twice, another option's name, and a number that is
    infinite or has underscores. The values of OPTIONAL_VALUES may be left out.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        add_optional_values(args)
        typed, _, _ = self.make_parser(ctx).parse_args(args=list(args))
        rest: list[str] = super().parse_args(ctx, args)
        params = self.get_params(ctx)
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


class Conversion:
    """The conversion of a parameter's value, which leaves to typer what it does not know.

    Typer converts by pydantic, whose import takes longer than all else that a short command does.
    """

    def __init__(self, param: Any) -> None:
        self.of_typer, param.get_runtime_param = param.get_runtime_param, lambda: self

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        described = param.type_descriptor
        kind, least, most = described.annotation, *limits_of(described.parameter_info)
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        if kind == list[str]:
            return list(value)
        if issubclass(kind, str | Path | Enum | int | float):
            with suppress(ValueError):
                plain = kind(value)
                if not isinstance(plain, int | float) or least <= plain <= most:
                    return plain
        return self.of_typer().coerce(value, param, ctx)


def limits_of(option: Any) -> tuple[float, float]:
    """The least and the largest value of an option."""
    return (
        -inf if option.min is None else option.min,
        inf if option.max is None else option.max,
    )


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
