"""Parsing of a command's arguments, refusal of odd values, and the layout of help texts."""

from __future__ import annotations

import re
from enum import Enum
from math import inf, isfinite
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from facets.core.plain_numbers import plain_number, suggest_name

#: Options that may be typed without a value: the value that this means, and the pattern of values.
OPTIONAL_VALUES = {"--web": ("0", r"[^-].*"), "--certify": ("20000", r"-?[\d.+e_]+")}
#: Title of the last section of a help text: options that several commands have and few runs need.
COMMON = "Options of several commands"
#: Words of a help text for values of a type, by the name that typer gives the type.
METAVARS = {"int": "N", "float": "NUMBER"}


class PlainParameters:
    """Commands whose parameters are converted by `Conversion`, and their help texts."""

    def get_params(self, ctx: Any) -> list[Any]:
        params: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for param in params:
            # an earlier typer converts without pydantic
            if hasattr(param, "get_runtime_param"):
                param.get_runtime_param = Conversion
        return params

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the help text; indented paragraphs, which are examples, keep their lines."""
        text = ctx.command.help
        ctx.command.help = re.sub(r"\n\n(?=    )", "\n\n\b\n", text)
        super().format_help_text(ctx, formatter)  # type: ignore[misc]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, the command's own options, and last its common options."""
        sections: dict[str, list[Any]] = {"Arguments": [], "Options": [], COMMON: []}
        for param in self.get_params(ctx):
            name, text = param.get_help_record(ctx)
            panel = COMMON if "--help" in param.opts else param.rich_help_panel
            title = panel or f"{param.param_type_name.title()}s"
            is_option = name.startswith("-")
            shown = describe_metavar(name) if is_option else name.partition(" <")[0]
            sections[title].append((shown, text))
        write_sections(formatter, sections)


def describe_metavar(name: str) -> str:
    """Write an option with its value, without Python's types: "--rate NUMBER"."""
    words = re.sub(r"<(\w+)[^>|]*>", lambda match: METAVARS.get(match[1], "TEXT"), name)
    return re.sub("[<>]", "", words)


def write_sections(formatter: Any, sections: dict[str, list[Any]]) -> None:
    """Write the sections of a help text that have rows, each a name with its meaning."""
    for title, rows in sections.items():
        if rows:
            with formatter.section(title):
                formatter.write_dl(rows)


class Group(PlainParameters, TyperGroup):
    """A group of commands."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the commands by subject, then the options."""
        sections: dict[str, list[Any]] = {}
        commands: Any = self.commands
        for name, command in commands.items():
            rows = sections.setdefault(command.rich_help_panel or "Commands", [])
            rows.append((name, command.get_short_help_str(100)))
        write_sections(formatter, sections)
        super().format_options(ctx, formatter)


class PlainCommand(PlainParameters, TyperCommand):
    """A command that takes values as they are."""


class Command(PlainCommand):
    """A command that refuses option values without a meaning.

    It refuses an empty value, the same value twice, another option's name, and a number that is
    infinite or has underscores. The values of OPTIONAL_VALUES may be omitted.
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
    """The conversion of a parameter's value.

    Typer converts by pydantic, whose import takes longer than everything else that a short command
    does.
    """

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        kind = param.type_descriptor.annotation
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        if kind == list[str]:
            return list(value)
        try:
            converted = kind(value)
            if isinstance(converted, int | float):
                require_in_range(converted, param)
        except ValueError as error:
            reason = str(error) if "allowed" in str(error) else why_unusable(kind, value)
            raise typer.BadParameter(reason, ctx=ctx, param=param) from None
        return converted


def require_in_range(number: float, option: Any) -> None:
    """Raise `ValueError` for a number outside of an option's range."""
    low = -inf if option.min is None else option.min
    high = inf if option.max is None else option.max
    if not low <= number <= high:
        allowed = f"{low:,} or more" if high == inf else f"{low:,} to {high:,}"
        raise ValueError(f"{number:,} is out of range; allowed: {allowed}")


def why_unusable(kind: type[Any], text: str) -> str:
    """Reason why a text is no value of a type: no number, or none of some words."""
    if issubclass(kind, Enum):
        words = [word.value for word in kind]
        return f"{text!r} is not one of {', '.join(words)}{suggest_name(text, words)}"
    return f"{text!r} is not a {'whole ' * (kind is int)}number"


def add_optional_values(args: list[str]) -> None:
    """Write the value after each option of OPTIONAL_VALUES that was typed without a value."""
    for n, text in enumerate(args):
        if text in OPTIONAL_VALUES:
            default, form = OPTIONAL_VALUES[text]
            if not re.fullmatch(form, "".join(args[n + 1 : n + 2])):
                args[n] = f"{text}={default}"


def why_meaningless(texts: list[str], is_number: bool, options: set[str]) -> str:
    """Reason why the typed values of an option have no meaning; "" if they have one."""
    for n, text in enumerate(texts):
        if not text.strip():
            return "the value is empty; give a value, or omit the option"
        if text in options:
            return f"a value is missing before the option {text}"
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
