"""The command line of a study."""

from __future__ import annotations

import argparse
from typing import Any


def parse_options(text: str | None, **defaults: Any) -> argparse.Namespace:
    """Parse options that a study declares by their defaults, which also tell their types; `text`,
    the study's docstring, says what they mean."""
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
