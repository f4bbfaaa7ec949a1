"""Reference made from the code when the pages are built: nothing of it is kept by hand.

`<!-- help: range-map -->` is replaced by what `facets range-map --help` prints,
`<!-- run: config list (first 4 lines) -->` by what that command prints when it is run now,
`<!-- keys: sensor.beam -->` by a table of the keys of that block of a configuration,
`<!-- keys -->` by a section for every block, `<!-- configurations -->` by the shipped ones, and
`<!-- face: model optics -->` by the signatures and docstrings of what `import facets` gives from
these folders of the package.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Any

from facets.config import purpose, shipped
from facets.config.json_schema import allowed_values, document, entry
from facets.config.show import scalar

HELP = re.compile(r"<!-- help: ([a-z -]+) -->")
RUN = re.compile(r"<!-- run: (config [a-z ]+?)(?: \(first (\d+) lines\))? -->")
KEYS = re.compile(r"<!-- keys(?:: ([a-z_.]+))? -->")
CONFIGURATIONS = "<!-- configurations -->"
FACE = re.compile(r"<!-- face: ([a-z_ ]+) -->")
#: What the names of `facets` are about, by the folder that they come from.
SUBJECTS = {
    "config": "Configurations",
    "model": "The model",
    "estimation": "Solving",
    "simulation": "Simulating",
    "characterization": "Ranges and uncertainties",
    "axis_tests": "Error motions of an axis",
    "responses": "Frequency responses",
    "design": "Layouts",
    "files": "Tables",
    "live": "Recordings",
    "core": "The sensor and its data",
    "detectors": "Noise of the detectors",
    "optics": "Parameters of the sensor",
}
COLUMNS = 88


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with its markers replaced."""
    text = HELP.sub(lambda found: f"```text\n{help_of(found[1])}\n```", markdown)
    text = RUN.sub(lambda found: run(found[1], int(found[2] or 0)), text)
    text = KEYS.sub(lambda found: keys_of(found[1]) if found[1] else all_keys(), text)
    text = FACE.sub(lambda found: face(found[1].split()), text)
    return text.replace(CONFIGURATIONS, configurations()) if CONFIGURATIONS in text else text


@cache
def whole_program() -> Any:
    """The program as what parses its arguments."""
    import typer
    from facets.cli import app

    return typer.main.get_command(app)


def context_of(command: Any, name: str, parent: Any) -> Any:
    """The context of a command, for a help as wide as a page."""
    return command.context_class(
        command, info_name=name, parent=parent, terminal_width=COLUMNS, max_content_width=COLUMNS
    )


def command_of(name: str) -> tuple[Any, Any]:
    """The command `facets NAME`, and the context that it is called in."""
    command, context = whole_program(), None
    whole = "facets"
    for word in name.split():
        context = context_of(command, whole, context)
        command = command.get_command(context, word)
        if command is None:
            raise KeyError(f"there is no command `facets {name}`")
        whole = word
    return command, context_of(command, whole, context)


def help_of(name: str) -> str:
    """What `facets NAME --help` prints, as wide as a page is."""
    command, context = command_of(name)
    text: str = command.get_help(context)
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


@cache
def run(line: str, count: int) -> str:
    """A quick command as it is typed, and what it prints; only the first lines, or all for 0."""
    from facets.cli import app
    from typer.testing import CliRunner

    result = CliRunner().invoke(app, line.split())
    if result.exit_code:
        raise RuntimeError(f"`facets {line}`, on a page, fails: {result.exception}")
    lines = result.stdout.splitlines()
    shown = lines[:count] + ["..."] * (count < len(lines)) if count else lines
    return "\n".join(["```console", f"$ facets {line}", *shown, "```"])


def command_names() -> list[str]:
    """Every command of the program, those of a group as two words."""
    names = []
    for name, command in whole_program().commands.items():
        names += [f"{name} {inner}" for inner in getattr(command, "commands", {})] or [name]
    return names


def configurations() -> str:
    """A table of the shipped configurations, each with the first sentence of its comment."""
    rows = "".join(f"| `{name}` | {purpose(name)} |\n" for name in shipped())
    return f"| name | what it is |\n| --- | --- |\n{rows}"


def face(folders: list[str]) -> str:
    """The package's names from some folders, by subject; the builder fills in the docstrings."""
    import facets

    lines = []
    homes = {name: file for file, names in facets._NAMES_OF.items() for name in names.split()}
    for folder in folders:
        lines += [f"## {SUBJECTS[folder]}", ""]
        lines += [
            f"::: facets.{file}.{name}"
            for name, file in sorted(homes.items())
            if file.split(".")[0] == folder
        ]
        lines.append("")
    return "\n".join(lines)


def all_keys() -> str:
    """A section for every block of keys, in the order in which a configuration has them."""
    return "\n".join(sections((), document()))


def keys_of(name: str) -> str:
    path = tuple(name.split("."))
    found = entry(path)
    if found is None:
        raise KeyError(f"there is no block `{name}` in a configuration")
    return "\n".join(table(path, found))


def sections(path: tuple[str | int, ...], block: dict[str, Any]) -> Iterator[str]:
    """The block's heading, its meaning and its keys; then the blocks inside it."""
    name = ".".join(map(str, path)).replace(".0", "[n]") or "At the top"
    yield f"\n{'#' * min(2 + (len(path) > 1), 4)} {f'`{name}`' if path else name}\n"
    yield sentence(block) + "\n"
    yield from table(path, block)
    for key in block.get("properties", {}):
        inner = entry((*path, key)) or {}
        if is_single(path, key):
            continue
        if (*path, key) == ("motions",):
            yield from motions()
        elif inner.get("properties"):
            yield from sections((*path, key), inner)
        elif is_block(inner):  # blocks with names of one's own
            yield from sections((*path, key, "NAME"), entry((*path, key, "NAME")) or {})
        elif "$ref" in inner.get("items", {}):  # a list of blocks
            yield from sections((*path, key, 0), entry((*path, key, 0)) or {})


def is_single(path: tuple[str | int, ...], key: str | int) -> bool:
    """Whether this is the block of one facet or detector, whose keys are those above it."""
    return path in (("sensor", "mirror"), ("sensor", "psd")) and key in ("a", "b", "c")


def sentence(block: dict[str, Any]) -> str:
    """What is said of a block, as a sentence."""
    words: str = block.get("description", "")
    return escaped(words[:1].upper() + words[1:].rstrip(".") + ".") if words else ""


def table(path: tuple[str | int, ...], block: dict[str, Any]) -> Iterator[str]:
    keys: dict[str, Any] = block.get("properties", {})
    if not keys:
        return
    yield "\n| key | meaning | allowed | default |\n| --- | --- | --- | --- |"
    for key in keys:
        yield row((*path, key))
    yield ""


def row(path: tuple[str | int, ...], kind: str = "") -> str:
    plain = example(kind) if kind else None
    found = entry(path, plain) or {}
    key, meaning = path[-1], escaped(found.get("description", ""))
    if is_block(found):
        return f"| `{key}` | {meaning} | {block_link(path, found, kind)} | |"
    default = f"`{scalar(found['default'])}`" if "default" in found else ""
    if found.get("default", 0) is None:
        default = "none"
    return f"| `{key}` | {meaning} | {escaped(allowed_values(path, plain))} | {default} |"


def block_link(path: tuple[str | int, ...], found: dict[str, Any], kind: str) -> str:
    """Where the keys of a block are told."""
    if kind:
        axes = list(found.get("properties", {}))
        if not axes:
            return "named blocks, below"
        return "a place" if "tx_mm" in axes else ", ".join(f"`{axis}`" for axis in axes)
    if is_single(path[:-1], path[-1]):
        return "the keys above, and `azimuth_deg`"
    named = not found.get("properties") and path != ("motions",)
    return f"[{'named blocks' if named else 'a block'}](#{''.join(map(str, path))}{'name' * named})"


def is_block(found: dict[str, Any]) -> bool:
    return any(key in found for key in ("properties", "patternProperties", "additionalProperties"))


def example(kind: str) -> dict[str, Any]:
    """A document with a motion of that kind, which tells `entry` what its keys are."""
    return {"motions": {"NAME": {"kind": kind}}}


def motions() -> Iterator[str]:
    """The kinds of motion: each is a block `motions.NAME` with its `kind`."""
    schema = document()
    (any_motion,) = schema["properties"]["motions"]["patternProperties"].values()
    yield "\n## `motions`\n"
    yield "Each block below `motions` has a name of your choice; its `kind` tells the other keys."
    for option in any_motion["anyOf"]:
        block = schema["$defs"][option["$ref"].removeprefix("#/$defs/")]
        (kind,) = block["properties"]["kind"]["enum"]
        yield f"\n### A motion of the kind `{kind}`\n"
        yield sentence(block) + "\n"
        yield "\n| key | meaning | allowed | default |\n| --- | --- | --- | --- |"
        for key in block["properties"]:
            if key != "kind":
                yield row(("motions", "NAME", key), kind)
        for key in block["properties"]:
            path = ("motions", "NAME", key, "NAME")
            inner = entry(path, example(kind)) if key != "kind" else None
            if inner and is_block(inner):
                yield f"\nA block of `{key}`: {sentence(inner)}\n"
                yield "\n| key | meaning | allowed | default |\n| --- | --- | --- | --- |"
                for own in inner["properties"]:
                    yield row((*path, own), kind)
        yield ""
    axes = ", ".join(f"`{axis}`" for axis in schema["$defs"]["Place"]["properties"])
    yield f"A place holds {axes}, with zero for each one that is left out.\n"


def escaped(text: str) -> str:
    """Text that may stand in a table's cell."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")
