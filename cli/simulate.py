"""Placeholder for `facets simulate`."""


def simulate() -> None:
    raise NotImplementedError
