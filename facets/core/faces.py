"""Import the public names of packages at their first use."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Any


def load_on_use(package: str, names_of: Mapping[str, str] | None = None) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package, which imports a name at its first use.

    names_of: public names, separated by spaces, by the module that defines them, written as in a
    relative import without the first dot. Other names are modules of the package.
    """
    homes = {name: home for home, names in (names_of or {}).items() for name in names.split()}

    def load(name: str) -> Any:
        if name in homes:
            value = getattr(import_module(f".{homes[name]}", package), name)
            setattr(sys.modules[package], name, value)
            return value
        if name.startswith("_") or find_spec(f"{package}.{name}") is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return import_module(f"{package}.{name}")

    return load
