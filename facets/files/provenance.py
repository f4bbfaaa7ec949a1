"""Provenance of results: entries about its origin in every table and run record."""

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
    """Entries for the head of a table: configuration and its checksum, the measured object, the
    program's version, seed, command and time."""
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
    """The entry of a table's head with the complete configuration, which CSV omits."""
    return {CONFIGURATION: resolved_text(config.resolved)}


def origin_line(config: Config) -> str:
    """The command and the configuration's checksum, in one line of a page or document."""
    return f"{command_line()}; sha256 of the configuration {config.sha256[:12]}"


def require_origin(source: Path, made: Mapping[str, Any], config: Config, remedy: str) -> None:
    """Raise `InputError` if an earlier result was not made from exactly this configuration.

    source: file or folder of the result.  made: provenance that the result states.  remedy: advice
    to the user.
    """
    checksum, name = made.get("config_sha256"), made.get("config")
    if checksum == config.sha256:
        return
    if not checksum:
        reason = (
            f"does not say from which configuration it was made, so {config.name} may be another"
        )
    elif name == config.name:
        version = made.get("facets", __version__)
        reason = f"was made from another state of {name}"
        reason += f", by facets {version}" if version != __version__ else ""
    else:
        other = f"configuration {name}" if name else "another configuration"
        reason = f"was made from {other}, not from {config.name}"
    raise InputError(f"{source}: {reason}; {remedy}")


def configuration(
    config: Config, block: dict[str, Any], about: dict[str, str], name: str = "sensor"
) -> str:
    """Write a complete configuration with one block replaced as YAML, below its provenance."""
    return _commented_yaml({**config.resolved, name: block}, about)


def extension(parent: Path | str, keys: dict[str, Any], about: dict[str, str]) -> str:
    """Write a configuration that extends `parent` by some keys as YAML, below its provenance."""
    return _commented_yaml({"extends": str(parent), **keys}, about)


def _commented_yaml(keys: dict[str, Any], about: dict[str, str]) -> str:
    from ruamel.yaml import YAML

    stream = StringIO()
    YAML().dump(keys, stream)
    return "\n".join([*head_lines(about), stream.getvalue()])


def run_record(config: Config, seed: int | None, seconds: float, results: dict[str, Any]) -> str:
    """Write the provenance, results and resolved configuration of a run as YAML."""
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
