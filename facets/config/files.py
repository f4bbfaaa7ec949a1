"""Find configuration files, and follow `extends` from one to the next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..core.errors import ConfigError
from ..core.plain_numbers import suggest_name
from .shipped_files import shipped
from .yaml_positions import Marked, path_text, read

SUFFIXES = (".yaml", ".yml", ".json")
#: Blocks whose keys are names that the user gives.
NAMED = (
    ("motions",),
    *(("optimize", "parts", kind) for kind in ("psds", "lasers", "amplifiers")),
)


def find(name_or_path: str | Path, base: Path | None = None) -> Path:
    """Find the file of a shipped configuration's name or of a path.

    base: folder at which relative paths start; None: the working directory. Raises ConfigError if
    there is no such file, without a file and line, which only the caller knows.
    """
    names = shipped()
    if isinstance(name_or_path, str) and name_or_path in names:
        return names[name_or_path]
    file = (base or Path.cwd()) / Path(name_or_path).expanduser()
    try:
        if file.is_file():
            return file.resolve()
        folder = file.is_dir()
    except OSError as error:
        raise ConfigError(f"{name_or_path}: {error.strerror}") from None
    if folder:
        raise ConfigError(f"{path_text(file)} is a folder, not a configuration file")
    raise ConfigError(_missing_file(str(name_or_path), file, names))


def _missing_file(name_or_path: str, file: Path, names: dict[str, Path]) -> str:
    nearby = [f.name for f in file.parent.glob("*") if f.suffix in SUFFIXES]
    bare = Path(name_or_path).name == name_or_path
    candidates = [*names, *nearby] if bare else nearby
    fault = (
        "no such file" if not bare or file.suffix in SUFFIXES else "no such file or shipped name"
    )
    same = [name for name in nearby if Path(name).stem == file.name]
    hint = suggest_name(file.name, candidates)
    if same:
        hint = f"; did you mean {same[0]!r}? The name of a file needs its ending"
    return f"{name_or_path}: {fault}{hint} (shipped names: {', '.join(names)})"


#: Largest number of files of one configuration.
MOST_FILES = 50


def gather(file: Path, files: dict[Path, Marked] | None = None) -> Marked:
    """Merge a file over all files that it extends; each value keeps its file and line.

    files: receives these files with their merged trees. Raises `ConfigError` with file and line for
    a missing file, a circle, or more than MOST_FILES files.
    """
    return _gather_files(file, (), {} if files is None else files)


def _gather_files(file: Path, children: tuple[Path, ...], merged: dict[Path, Marked]) -> Marked:
    """Merge a file over the files that it extends.

    children: the files that lead to this one by `extends`.  merged: receives each merged file, so
    that none is read twice.
    """
    if file in merged:
        return merged[file]
    tree = read(file)
    _drop_imperfections(tree)
    extends = tree.value.pop("extends", None)
    links: list[Marked] = []
    if extends is not None and extends.value is not None:
        links = extends.value if isinstance(extends.value, list) else [extends]
    chain = (*children, file)
    result: Marked | None = None
    for link in links:
        parent = _find_parent(link)
        if parent in chain:
            circle = " -> ".join(path_text(f) for f in (*chain[chain.index(parent) :], parent))
            raise ConfigError(
                f"{link.place}: extends: the files extend each other in a circle: {circle}"
            )
        if len(merged) + len(chain) > MOST_FILES:
            raise ConfigError(
                f"{link.place}: extends: more than {MOST_FILES} files in all; combine some of them"
            )
        below = _gather_files(parent, chain, merged)
        result = below if result is None else merge(result, below)
    merged[file] = tree if result is None else merge(result, tree)
    return merged[file]


def _drop_imperfections(tree: Marked) -> None:
    """Drop the block `sensor.imperfections` of version 0.2 from a file if all its effects are off.

    Raises ConfigError for an effect that is on; later versions have it in `sensor.light`.
    """
    sensor = tree.value.get("sensor")
    if sensor is None or not isinstance(sensor.value, dict):
        return
    block = sensor.value.get("imperfections")
    if block is None or not isinstance(block.value, dict):
        return
    del sensor.value["imperfections"]
    for name, value in block.plain().items():
        if name.startswith(("sag_over", "rolloff_width", "background_mm")):
            continue  # without effect unless another key is set
        if any(value) if isinstance(value, list) else value:
            raise ConfigError(
                f"{block.value[name].place}: sensor.imperfections.{name}: this block no longer "
                "exists; give the effect in sensor.light, simulate with it, and solve the readings "
                "with a configuration without it"
            )


def _find_parent(link: Marked) -> Path:
    if not isinstance(link.value, str):
        got = f"(got {link.plain()!r})"
        raise ConfigError(
            f"{link.place}: extends: must be a shipped name or a path, or a list of them {got}"
        )
    try:
        return find(link.value, link.file.parent)
    except ConfigError as error:
        raise ConfigError(f"{link.place}: extends: {error}") from None


def merge(parent: Marked, child: Marked, path: tuple[str, ...] = ()) -> Marked:
    """Replace the keys of `parent` by the keys of `child`; lists are replaced as a whole.

    A motion that changes `kind` replaces the inherited one. A motion or a part without a value
    (`x-steps:`) removes the inherited one.
    """
    if not isinstance(parent.value, dict):
        return replace(child, below=parent)
    if child.value is None:
        return parent
    if not isinstance(child.value, dict) or _changes_kind(parent, child, path):
        return replace(child, below=parent)
    merged = dict(parent.value)
    for key, value in child.value.items():
        if key not in merged:
            merged[key] = value
        elif path in NAMED and value.value is None:
            del merged[key]
        else:
            merged[key] = merge(merged[key], value, (*path, key))
    return Marked(merged, child.file, child.line)


def _changes_kind(parent: Marked, child: Marked, path: tuple[str, ...]) -> bool:
    if len(path) != 2 or path[0] != "motions" or "kind" not in child.value:
        return False
    before = parent.value.get("kind")
    return before is None or before.value != child.value["kind"].value
