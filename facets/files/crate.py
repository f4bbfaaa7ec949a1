"""`ro-crate-metadata.json`: what a folder of results holds, for archives and other programs.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1), which is JSON-LD by schema.org: the folder as a
Dataset, its files with size, type and SHA-256, each column with its unit, and the run that made
them. Whoever publishes the folder adds a license and authors.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .tables import column_names, unit_of_column
from .whole import readable_path, write_text

NAME = "ro-crate-metadata.json"
PROFILE = "https://w3id.org/ro/crate/1.1"
#: Identifier of the entity that marks a crate written by this program.
PROGRAM = "#facets"
TYPES = {
    ".csv": "text/csv",
    ".parquet": "application/vnd.apache.parquet",
    ".h5": "application/x-hdf5",
    ".yaml": "application/yaml",
    ".json": "application/json",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".pdf": "application/pdf",
    ".html": "text/html",
}
#: UCUM code of each unit, which RO-Crates use for `unitCode`.
UCUM = {"mm": "mm", "mrad": "mrad", "mW": "mW", "um": "um", "urad": "urad", "s": "s", "us": "us"}


def write_crate(folder: Path, files: Sequence[Path], about: dict[str, str], seconds: float) -> None:
    """Write the description of a folder's existing files.

    about: as in the head of a table.  seconds: duration of the run. A description that another
    program wrote into the folder is not changed.
    """
    path = folder / NAME
    if path.exists() and not is_ours(path):
        return
    there = [file for file in files if readable_path(file).is_file()]
    text = json.dumps(crate(there, about, seconds), indent=1, ensure_ascii=False)
    write_text(path, text + "\n")


def is_ours(path: Path) -> bool:
    """Return whether this program wrote a description."""
    try:
        content = json.loads(path.read_text("utf-8"))
        return any(entity.get("@id") == PROGRAM for entity in content["@graph"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return False


def crate(files: Sequence[Path], about: dict[str, str], seconds: float) -> dict[str, Any]:
    """Describe files in one folder."""
    columns = [column for file in files for column in columns_of(file)]
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": about["command"],
        "description": f"Results of `{about['command']}` by facets {about['facets']}; "
        f"configuration {about['config']}, SHA-256 {about['config_sha256']}.",
        "datePublished": about["made"],
        "hasPart": [{"@id": file.name} for file in files],
        "variableMeasured": [{"@id": column["@id"]} for column in columns],
        "mentions": {"@id": "#run"},
    }
    run = {
        "@id": "#run",
        "@type": "CreateAction",
        "name": about["command"],
        "endTime": about["made"],
        "description": f"took {seconds:.3f} s"
        + (f", seed {about['seed']}" if "seed" in about else ""),
        "instrument": {"@id": PROGRAM},
        "result": [{"@id": file.name} for file in files],
    }
    program = {
        "@id": PROGRAM,
        "@type": "SoftwareApplication",
        "name": "facets",
        "version": about["facets"],
        "softwareVersion": about["facets"],
    }
    head = {
        "@id": NAME,
        "@type": "CreativeWork",
        "conformsTo": {"@id": PROFILE},
        "about": {"@id": "./"},
    }
    entities = [head, root, run, program, *(entity_of(file) for file in files), *columns]
    context = [f"{PROFILE}/context", {"sha256": "https://schema.org/sha256"}]
    return {"@context": context, "@graph": entities}


def entity_of(file: Path) -> dict[str, Any]:
    content = readable_path(file)
    with content.open("rb") as data:
        total = hashlib.file_digest(data, "sha256").hexdigest()
    return {
        "@id": file.name,
        "@type": "File",
        "name": file.name,
        "encodingFormat": TYPES.get(file.suffix.lower(), "application/octet-stream"),
        "contentSize": str(content.stat().st_size),
        "sha256": total,
    }


def columns_of(file: Path) -> list[dict[str, Any]]:
    """Columns of a table that have a unit; none for files that are not tables."""
    columns = []
    for name in column_names(readable_path(file)):
        unit = unit_of_column(name)
        if not unit:
            continue
        column = {
            "@id": f"#{file.name}/{name}",
            "@type": "PropertyValue",
            "name": name,
            "unitText": unit,
            "subjectOf": {"@id": file.name},
        }
        columns.append(column | ({"unitCode": UCUM[unit]} if unit in UCUM else {}))
    return columns
