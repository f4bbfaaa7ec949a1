"""The command line of a study."""

from __future__ import annotations

import argparse
from typing import Any


def parse_options(text: str | None, **defaults: Any) -> argparse.Namespace:
    """Parse the options of a study, which are declared by their defaults.

    text: help of the study, its docstring, which describes the options. The type of an option is
    that of its default; False declares a flag.
    """
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in defaults.items():
        option = f"--{name.replace('_', '-')}"
        if default is False:
            parser.add_argument(option, action="store_true")
        else:
            parser.add_argument(option, type=type(default), default=default)
    return parser.parse_args()
