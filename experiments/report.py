"""The page about a run: figures, comparisons with the paper, checks and configurations."""

from __future__ import annotations

import platform
from base64 import b64encode
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2

import facets
from facets.config import to_yaml
from facets.core.hues import chosen_hues
from facets.files.provenance import PACKAGES, command_line
from facets.files.whole import readable_path, write_text

from .reproduce import ExperimentResult

TEMPLATE = Path(__file__).parent / "report.html"


def number(value: float) -> str:
    """Write a number with four digits; an empty text for NaN."""
    if value != value:
        return ""
    if value == int(value) and 1e4 <= abs(value) < 1e7:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.4g}" if abs(value) < 1e5 else f"{value:.3g}"


def embed_picture(path: Path | None) -> str:
    """Encode a picture as a data address, so that the page needs no other file; empty for no
    picture."""
    if path is None:
        return ""
    return "data:image/svg+xml;base64," + b64encode(readable_path(path).read_bytes()).decode()


def facts() -> dict[str, str]:
    """The versions, the command, the time and the machine of this run."""
    return {
        "facets": facets.__version__,
        "command": command_line(),
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "Python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
        "machine": f"{platform.system()} {platform.machine()}",
    }


def write_report(path: Path, results: list[ExperimentResult], quick: bool) -> None:
    """Write the page, completely or not at all."""
    places = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined,
                                trim_blocks=True, lstrip_blocks=True)  # fmt: skip
    places.filters |= {"number": number, "embedded": embed_picture}
    page = places.from_string(TEMPLATE.read_text("utf-8"))
    configs: dict[str, Any] = {}
    for name in dict.fromkeys(result.config for result in results):
        config = facets.load(name)
        configs[name] = {"sha256": config.sha256, "text": to_yaml(config)}
    text = page.render(
        results=results, quick=quick, facts=facts(), configs=configs, css=chosen_hues().css
    )
    write_text(path, text)
