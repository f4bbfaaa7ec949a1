"""Provenance of results: the entries of every table and run record about its origin."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError
from ..core.names import escape_undecodable
from ..core.settings import resolved_text
from ..core.version import __version__
from .columns import CONFIGURATION
from .tables import head_lines

if TYPE_CHECKING:
    from ..core.settings import Config

PACKAGES = ("numpy", "scipy", "llvmlite")


def command_line() -> str:
    """The command line as typed, with the program's bare name; see `escape_undecodable`."""
    import shlex

    return escape_undecodable(shlex.join(["facets", *sys.argv[1:]]))


def provenance_header(config: Config, seed: int | None = None) -> dict[str, str]:
    """Entries for the head of a table: config and its hash, the measured object, version, seed,
    command, time."""
    entries = {
        "config": config.name,
        "config_sha256": config.sha256,
        "object": None if config.object is None else config.object.text,
        "facets": __version__,
        "seed": None if seed is None else str(seed),
        "command": command_line(),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    return {key: value for key, value in entries.items() if value is not None}


def configuration_entry(config: Config) -> dict[str, str]:
    """The entry of a table's head with the whole configuration; CSV leaves it out."""
    return {CONFIGURATION: resolved_text(config.resolved)}


def origin_line(config: Config) -> str:
    """Describe in one line how a page or a document was made."""
    return f"{command_line()}; sha256 of the configuration {config.sha256[:12]}"


def require_origin(source: Path, made: Mapping[str, Any], config: Config, remedy: str) -> None:
    """Raise `InputError` if an earlier result was not made from exactly this configuration.

    source: the result's file or folder.  made: provenance that the result states, as `about`.
    remedy: what to do instead.
    """
    checksum, name = made.get("config_sha256"), made.get("config")
    if checksum == config.sha256:
        return
    if not checksum:
        what = f"does not say from which configuration it was made, so {config.name} may be another"
    elif name == config.name:
        by = made.get("facets", __version__)
        what = f"was made from another state of {name}"
        what += f", by facets {by}" if by != __version__ else ""
    else:
        of = f"configuration {name}" if name else "another configuration"
        what = f"was made from {of}, not from {config.name}"
    raise InputError(f"{source}: {what}; {remedy}")


def configuration(
    config: Config, block: dict[str, Any], about: dict[str, str], name: str = "sensor"
) -> str:
    """Write a configuration as YAML with one block replaced, below its provenance."""
    return _commented_yaml({**config.resolved, name: block}, about)


def extension(parent: Path | str, keys: dict[str, Any], about: dict[str, str]) -> str:
    """Write YAML that extends another configuration by some keys, below its provenance."""
    return _commented_yaml({"extends": str(parent), **keys}, about)


def _commented_yaml(keys: dict[str, Any], about: dict[str, str]) -> str:
    from ruamel.yaml import YAML

    stream = StringIO()
    YAML().dump(keys, stream)
    return "\n".join([*head_lines(about), stream.getvalue()])


def run_record(config: Config, seed: int | None, seconds: float, results: dict[str, Any]) -> str:
    """Describe a run completely, as YAML."""
    from importlib.metadata import version

    from ruamel.yaml import YAML

    stream = StringIO()
    yaml = YAML()
    yaml.width = 100
    yaml.dump(
        {
            **provenance_header(config, seed),
            "seconds": round(seconds, 3),
            "python": platform.python_version(),
            "packages": {name: version(name) for name in PACKAGES},
            "results": results,
            "resolved": config.resolved,
        },
        stream,
    )
    return stream.getvalue()
