"""Find the keys of a configuration that cause a problem, and their lines.

The message names keys of the loaded file, which the user can change; keys of the files that it
extends are named only if no key of the loaded file contributes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from .yaml_positions import Marked, Path_, dotted_path

Misses = Callable[[Marked], float]
SENSOR: Path_ = ("sensor",)


def message(tree: Marked, paths: Sequence[Path_], reason: str) -> str:
    """Write `FILE:LINE: key.path: reason` for the first key that the loaded file sets, else for the
    first that any file sets; the other keys follow the reason."""
    marks = [(*tree.find(path), path) for path in paths]
    present = [(mark, path) for mark, at, path in marks if at == path]
    present.sort(key=lambda pair: pair[0].file != tree.file)
    (mark, path), *others = present or [(marks[0][0], paths[0])]
    other_keys = ", ".join(f"{dotted_path(path)} ({other.place})" for other, path in others)
    text = reason if reason.startswith(dotted_path(path)) else f"{dotted_path(path)}: {reason}"
    return f"{mark.place}: {text}{other_keys and f'; together with {other_keys}'}"


def leaves(mark: Marked, path: Path_ = ()) -> Iterator[tuple[Path_, Marked]]:
    """The paths and values of a tree's keys, apart from keys that hold blocks."""
    if isinstance(mark.value, dict):
        for key, child in mark.value.items():
            yield from leaves(child, (*path, key))
    else:
        yield path, mark


def remove_keys(tree: Marked, paths: Sequence[Path_]) -> Marked:
    """Return the tree without the keys at some paths."""
    for path in paths:
        tree = _remove_key(tree, path)
    return tree


def _remove_key(mark: Marked, path: Path_) -> Marked:
    key, *rest = path
    inside = dict(mark.value)
    if rest:
        inside[key] = _remove_key(inside[key], tuple(rest))
    elif (below := inside[key].below) is not None:
        inside[key] = below
    else:
        del inside[key]
    return replace(mark, value=inside)


def culprits(tree: Marked, misses: Misses) -> list[Path_]:
    """Find the keys of the sensor without which the configuration would not fail.

    misses: size of a tree's failure; 1 or less if it does not fail. The result is one key of the
    loaded file if that suffices, else few keys of that file, else of all files.
    """
    entries = list(leaves(tree.find(SENSOR)[0], SENSOR))
    file_paths = [path for path, mark in entries if mark.file == tree.file]
    for paths in (file_paths, [path for path, _ in entries]):
        sizes = [(misses(remove_keys(tree, [path])), n) for n, path in enumerate(paths)]
        if sizes and min(sizes)[0] <= 1:
            return [paths[min(sizes)[1]]]
        if paths and misses(remove_keys(tree, paths)) <= 1:
            return smallest_set(tree, paths, misses)
    return file_paths[:1] or [SENSOR]


def smallest_set(tree: Marked, paths: list[Path_], misses: Misses) -> list[Path_]:
    """Reduce a set of keys whose removal avoids the failure, by restoring one after the other."""
    chosen = list(paths)
    for path in paths:
        fewer = [other for other in chosen if other != path]
        if misses(remove_keys(tree, fewer)) <= 1:
            chosen = fewer
    return chosen
