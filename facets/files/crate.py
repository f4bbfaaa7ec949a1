"""Write `ro-crate-metadata.json`, which describes a folder of results to other programs.

RO-Crate 1.1 (https://w3id.org/ro/crate/1.1) is JSON-LD by schema.org. It describes the folder as a
Dataset, its files with size, type and SHA-256, each column with its unit, and the run that made
them. Before publication, the user adds a license and authors.
"""

from __future__ import annotations

import hashlib
import json
import mimetypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .tables import column_names, unit_of_column
from .whole import readable_path, write_text

NAME = "ro-crate-metadata.json"
PROFILE = "https://w3id.org/ro/crate/1.1"
#: Identifier of the entity that marks a crate written by this program.
PROGRAM = "#facets"
#: Units whose spelling is also their code in UCUM, which RO-Crates use for `unitCode`.
UCUM = ("mm", "mrad", "mW", "um", "urad", "s", "us")


def write_crate(folder: Path, files: Sequence[Path], about: dict[str, str], seconds: float) -> None:
    """Write the description of a folder's existing files.

    about: provenance, as in the head of a table.  seconds: duration of the run. A description that
    another program wrote remains unchanged.
    """
    path = folder / NAME
    if path.exists() and f'"{PROGRAM}"'.encode() not in path.read_bytes():
        return
    present = [file for file in files if readable_path(file).is_file()]
    text = json.dumps(crate(present, about, seconds), indent=1, ensure_ascii=False)
    write_text(path, text + "\n")


def crate(files: Sequence[Path], about: dict[str, str], seconds: float) -> dict[str, Any]:
    """The description of files in one folder, as a JSON object; see `write_crate`."""
    parts = [file_entity(file) for file in files]
    columns = [column for file in files for column in column_entities(file)]
    results = [{"@id": part["@id"]} for part in parts]
    command, program, made = about["command"], f"facets {about['facets']}", about["made"]
    seed = f", seed {about['seed']}" if "seed" in about else ""
    entities = [
        entity(NAME, "CreativeWork", NAME, conformsTo={"@id": PROFILE}, about={"@id": "./"}),
        entity(
            "./",
            "Dataset",
            command,
            description=f"Results of `{command}` by {program}; "
            f"configuration {about['config']}, SHA-256 {about['config_sha256']}.",
            datePublished=made,
            hasPart=results,
            variableMeasured=[{"@id": column["@id"]} for column in columns],
            mentions={"@id": "#run"},
        ),
        entity(
            "#run",
            "CreateAction",
            command,
            description=f"took {seconds:.3f} s{seed}",
            endTime=made,
            instrument={"@id": PROGRAM},
            result=results,
        ),
        entity(PROGRAM, "SoftwareApplication", "facets", softwareVersion=about["facets"]),
    ]
    context = [f"{PROFILE}/context", {"sha256": "https://schema.org/sha256"}]
    return {"@context": context, "@graph": [*entities, *parts, *columns]}


def entity(identifier: str, kind: str, name: str, **properties: Any) -> dict[str, Any]:
    return {"@id": identifier, "@type": kind, "name": name, **properties}


def file_entity(file: Path) -> dict[str, Any]:
    content = readable_path(file).read_bytes()
    return entity(
        file.name,
        "File",
        file.name,
        encodingFormat=mimetypes.guess_type(file)[0] or "application/octet-stream",
        contentSize=str(len(content)),
        sha256=hashlib.sha256(content).hexdigest(),
    )


def column_entities(file: Path) -> list[dict[str, Any]]:
    """Entities of a table's columns that have a unit; none for files that are not tables."""
    columns = []
    for name in column_names(readable_path(file)):
        if unit := unit_of_column(name):
            key, code = f"#{file.name}/{name}", {"unitCode": unit} if unit in UCUM else {}
            columns.append(entity(key, "PropertyValue", name, unitText=unit, **code))
    return columns
