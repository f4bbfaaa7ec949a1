"""Placeholder for `facets solve`."""


def solve() -> None:
    raise NotImplementedError
