"""The manual page of the program in the language of `man`, made from its help."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

#: Width of the help for the page, so large that no line is broken.
WIDTH = 10_000


def manual(command: Any, version: str, status: str) -> str:
    """A page for section 1.

    command: the program's parser.  status: meaning of its exit status.
    """
    context = context_of(command, "facets", None)
    name = escape(command.help.partition(":")[0])
    lines = [f'.TH FACETS 1 "" "facets {version}" "User commands"', ".SH NAME"]
    lines += [f"facets \\- {name[0].lower()}{name[1:]}", ".SH SYNOPSIS"]
    lines += [f".B facets\n{escape(command.get_usage(context).partition('facets ')[2])}"]
    lines += [
        ".SH DESCRIPTION",
        escape(command.help),
        *options(command, context),
        ".SH COMMANDS",
    ]
    for called, inner in commands(command, context):
        usage = inner.get_usage(called).partition(f"{called.command_path} ")[2]
        lines += [
            f".SS {escape(called.command_path)}",
            f".B {escape(called.command_path)}",
        ]
        lines += [escape(usage), ".PP", *paragraphs(inner.help or ""), *options(inner, called)]
    lines += [".SH EXIT STATUS", ".nf", *map(escape, status.splitlines()), ".fi"]
    return "\n".join(lines) + "\n"


def context_of(command: Any, name: str, parent: Any, width: int = WIDTH) -> Any:
    """Make the context of a command, for a help of this width in characters."""
    return command.context_class(
        command, info_name=name, parent=parent, terminal_width=width, max_content_width=width
    )


def commands(command: Any, context: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every command of the program, including those of groups, with its context."""
    for name, inner in command.commands.items():
        called = context_of(inner, name, context)
        if hasattr(inner, "commands"):
            yield from commands(inner, called)
        else:
            yield called, inner


def options(command: Any, context: Any) -> Iterator[str]:
    """Write the arguments and options of a command, each with its help."""
    for param in command.get_params(context):
        record = param.get_help_record(context)
        if record is not None:
            words, help_text = record
            yield f".TP\n.B {escape(words)}\n{escape(help_text)}"


def paragraphs(text: str) -> Iterator[str]:
    for part in re.split(r"\n\s*\n", text.strip()):
        yield f"{escape(' '.join(part.split()))}\n.PP"


def escape(text: str) -> str:
    """Escape backslashes and leading dots, in which `man` would find commands."""
    safe = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{safe}" if safe.startswith((".", "'")) else safe
