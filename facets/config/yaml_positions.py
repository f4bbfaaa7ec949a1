"""Read YAML so that every value has the file and line of its origin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode
from ruamel.yaml.reader import ReaderError

from ..core.errors import ConfigError

Path_ = tuple[str | int, ...]

#: Largest size and number of values of a configuration, which usually has some hundred values.
#: Aliases that refer to each other could multiply a few lines until the memory is full.
MOST_VALUES = 20_000
MOST_BYTES = 1_000_000


@dataclass(frozen=True)
class Marked:
    """A YAML value with its position.

    value: a scalar, a list of Marked, or a dict of Marked by key.  line: in the file, from 1; of
    the key for an entry of a mapping.  below: the value of the same key in the files that this one
    extends, or None.
    """

    value: Any
    file: Path
    line: int
    below: Marked | None = None

    @property
    def place(self) -> str:
        return f"{path_text(self.file)}:{self.line}"

    def plain(self) -> Any:
        """The value without positions, as plain types."""
        if isinstance(self.value, dict):
            return {key: child.plain() for key, child in self.value.items()}
        if isinstance(self.value, list):
            return [child.plain() for child in self.value]
        return self.value

    def find(self, path: Path_) -> tuple[Marked, Path_]:
        """The value at a path, or the deepest existing value above it, with that value's path."""
        value: Marked = self
        for depth, key in enumerate(path):
            inside = value.value
            has_key = isinstance(inside, dict) and key in inside
            if not has_key and not (isinstance(inside, list) and key in range(len(inside))):
                return value, path[:depth]
            value = inside[key]
        return value, path


def path_text(file: Path) -> str:
    """Write a path, relative to the working directory if it lies within it."""
    try:
        return str(file.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(file)


def read(file: Path) -> Marked:
    """Read one YAML file.

    Raises `ConfigError` with file and line if it cannot be read or is not valid YAML.
    """
    text = _read_text(file)
    yaml = YAML(typ="safe", pure=True)
    try:
        root = yaml.compose(text)
        reader = _Reader(file, yaml)
        tree = reader.mark(root, root.start_mark.line + 1, ()) if root else Marked({}, file, 1)
    except YAMLError as error:
        raise ConfigError(_syntax_message(file, error, text)) from None
    except (ValueError, OverflowError) as error:  # ruamel raises these for invalid values.
        raise ConfigError(f"{path_text(file)}: not valid YAML: {error}") from None
    except RecursionError:
        raise ConfigError(f"{path_text(file)}: nested too deeply") from None
    if reader.problems:
        raise ConfigError("\n".join(reader.problems))
    if not isinstance(tree.value, dict) or not tree.value:
        raise ConfigError(
            f"{tree.place}: {'' if text.strip() else 'is empty; '}a configuration is made of "
            "`key: value` lines; `extends: paper` alone is the paper's rig"
        )
    return tree


def _read_text(file: Path) -> str:
    try:
        size = file.stat().st_size
        if size > MOST_BYTES:
            raise ConfigError(
                f"{path_text(file)}: has {size:,} bytes; a configuration has at most {MOST_BYTES:,}"
            )
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"{path_text(file)}:{line}: not UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(f"{path_text(file)}: cannot be read: {reason}") from None


#: Messages of ruamel, and the most frequent remedy for each.
ADVICE = {
    "expected <block end>": "check the indentation",
    "inconsistent indentation": "check the indentation",
    "cannot start any token": "indent with spaces, and quote text with special characters",
    "mapping values are not allowed": "one `key: value` a line; quote text that holds ': '",
    "expected ',' or": "a comma or a closing bracket is missing",
    "could not find expected ':'": "a key needs a colon and a space: `key: value`",
    "determine a constructor": "leave the tag (!...) out",
}


def _syntax_message(file: Path, error: YAMLError, text: str) -> str:
    if isinstance(error, ReaderError):
        line = text[: error.position].count("\n") + 1
        return (
            f"{path_text(file)}:{line}: not valid YAML: it holds the character {error.character!r}"
        )
    if not isinstance(error, MarkedYAMLError):
        return f"{path_text(file)}: not valid YAML: {error}"
    mark, opened = error.problem_mark or error.context_mark, error.context_mark
    place = path_text(file) if mark is None else f"{path_text(file)}:{mark.line + 1}"
    what = str(error.problem)
    if error.context:
        begun = f" begun in line {opened.line + 1}" if opened and opened is not mark else ""
        what = f"{error.context}{begun}, {what}"
    advice = next((cure for sign, cure in ADVICE.items() if sign in what), "")
    return f"{place}: not valid YAML: {what}{advice and '; ' + advice}"


class _Reader:
    """Converter of ruamel's nodes to `Marked` values, which collects the problems."""

    def __init__(self, file: Path, yaml: YAML) -> None:
        self.file = file
        self.constructor = yaml.constructor
        self.problems: list[str] = []
        self.open: list[Node] = []
        self.count, self.block = 0, ("", 1)

    def mark(self, node: Node, line: int, path: Path_) -> Marked:
        self._count_value()
        if isinstance(node, ScalarNode):
            return Marked(self._scalar(node, line, path), self.file, line)
        if any(node is outer for outer in self.open):
            self._problem(line, path, "an alias that contains itself")
            return Marked(None, self.file, line)
        self.open.append(node)
        value: Any
        if isinstance(node, MappingNode):
            value = dict(self._entries(node, path))
        else:
            value = [
                self.mark(item, item.start_mark.line + 1, (*path, index))
                for index, item in enumerate(node.value)
            ]
        self.open.pop()
        return Marked(value, self.file, line)

    def _count_value(self) -> None:
        """Raise `ConfigError` if a file holds more values than any configuration."""
        self.count += 1
        if self.count > MOST_VALUES:
            key, line = self.block
            raise ConfigError(
                f"{path_text(self.file)}:{line}: {key}: more than {MOST_VALUES:,} values, "
                "including those of aliases (*name); do not let aliases contain aliases"
            )

    def _scalar(self, node: ScalarNode, line: int, path: Path_) -> Any:
        try:
            value = self.constructor.construct_object(node)
        except (ValueError, OverflowError) as error:  # such as an impossible date
            self._problem(line, path, f"not a value: {str(error).partition(';')[0]}")
            return None
        if isinstance(value, int | float) and "_" in node.value:
            self._problem(line, path, f"a number has no underscores (got {node.value})")
        return node.value if isinstance(value, date) else value  # Keys take dates as text only.

    def _entries(self, node: MappingNode, path: Path_) -> Iterator[tuple[str, Marked]]:
        lines: dict[str, int] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, ScalarNode):
                self._problem(line, path, "a key must be a plain name")
                continue
            key = str(key_node.value)
            if not path:
                self.block = key, line
            if key == "<<":
                self._problem(line, (*path, key), "merge keys are not supported; use `extends`")
            elif key in lines:
                twice = f"given twice, first in line {lines[key]}; keep one"
                self._problem(line, (*path, key), twice)
            else:
                lines[key] = line
                yield key, self.mark(value_node, line, (*path, key))

    def _problem(self, line: int, path: Path_, reason: str) -> None:
        where = f"{dotted_path(path)}: " if path else ""
        self.problems.append(f"{path_text(self.file)}:{line}: {where}{reason}")


def dotted_path(path: Path_) -> str:
    """Write a path with dots: sensor.beam.tilt_mrad[1]."""
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else str(key)
    return text
