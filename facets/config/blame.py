"""Find the keys that cause a problem, and their lines.

A user can change the loaded file, so its keys are named if any of them takes part, and keys of the
files that it extends only otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from .yaml_positions import Marked, Path_, dotted_path

Misses = Callable[[Marked], float]
SENSOR: Path_ = ("sensor",)


def message(tree: Marked, paths: Sequence[Path_], reason: str) -> str:
    """Write `FILE:LINE: key.path: reason`, for the first key that the user's own file sets, else
    for the first that any file sets; the other keys follow the reason."""
    marks = [(*tree.find(path), path) for path in paths]
    present = [(mark, path) for mark, at, path in marks if at == path]
    present.sort(key=lambda pair: pair[0].file != tree.file)
    (mark, path), *others = present or [(marks[0][0], paths[0])]
    other_keys = ", ".join(f"{dotted_path(path)} ({other.place})" for other, path in others)
    text = reason if reason.startswith(dotted_path(path)) else f"{dotted_path(path)}: {reason}"
    return f"{mark.place}: {text}{other_keys and f'; together with {other_keys}'}"


def leaves(mark: Marked, path: Path_ = ()) -> Iterator[tuple[Path_, Marked]]:
    """The values of a tree that are not blocks of keys, with their paths."""
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
    """The keys of the sensor that make it fail.

    misses: measures the failure of a tree; 1 or less for none. The result is one key of
    the user's own file if that suffices, else the fewest of that file, else the fewest of all
    files.
    """
    every = list(leaves(tree.find(SENSOR)[0], SENSOR))
    of_file = [path for path, mark in every if mark.file == tree.file]
    for some in (of_file, [path for path, _ in every]):
        alone = [(misses(remove_keys(tree, [path])), n) for n, path in enumerate(some)]
        if alone and min(alone)[0] <= 1:
            return [some[min(alone)[1]]]
        if some and misses(remove_keys(tree, some)) <= 1:
            return smallest_set(tree, some, misses)
    return of_file[:1] or [SENSOR]


def smallest_set(tree: Marked, paths: list[Path_], misses: Misses) -> list[Path_]:
    """The smallest subset of keys whose removal suffices, found by restoring them one after the
    other."""
    chosen = list(paths)
    for path in paths:
        fewer = [other for other in chosen if other != path]
        if misses(remove_keys(tree, fewer)) <= 1:
            chosen = fewer
    return chosen
