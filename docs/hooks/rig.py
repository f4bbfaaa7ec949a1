"""A sensor to play with on a page: `<!-- rig: paper -->` shows what `facets render` makes of it.

The page of the configuration of that name becomes a part of the documentation, in a frame where the
marker stands and by itself behind a link.
"""

from __future__ import annotations

import posixpath
import re
from typing import Any

import numpy as np
from properdocs.structure.files import File

from facets.config import load
from facets.pictures import rig_page

RIG = re.compile(r"<!-- rig: ([\w-]+) -->")
#: Where the mirror stands at first: off its place in all directions; no two spots are alike.
STATE = np.array([0.08, 0.05, 0.5, 0.003, 0.004, 0.006, 0.0, 0.0])


def on_files(files: Any, *, config: Any) -> Any:
    """Adds the page of each sensor that a marker names."""
    texts = [file.content_string for file in files.documentation_pages()]
    for name in sorted({found for text in texts for found in RIG.findall(text)}):
        settings = load(name)
        page = rig_page(settings.sensor, name, STATE, config=settings)
        files.append(File.generated(config, place(name), content=page))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """The page with its markers replaced by frames."""
    folder = posixpath.dirname(page.file.src_uri)
    return RIG.sub(lambda found: frame(found[1], folder), markdown)


def place(name: str) -> str:
    """Of a sensor's page, from the root of the documentation."""
    return f"rigs/{name}.html"


def frame(name: str, folder: str) -> str:
    address = posixpath.relpath(place(name), folder or ".")
    return (
        f'<iframe class="rig" src="{address}?theme=light" title="The sensor {name} to play with" '
        'loading="lazy"></iframe>\n\n'
        f'<a href="{address}">This sensor on a page of its own</a>: move mirror and beam, '
        "and see what the detectors read."
    )
