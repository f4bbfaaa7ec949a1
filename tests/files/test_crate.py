"""What a folder of results says of itself to archives: the shape that RO-Crate 1.1 asks for."""

import hashlib
import json

import pytest

import facets
from facets.files import provenance, tables

NAME, PROFILE = "ro-crate-metadata.json", "https://w3id.org/ro/crate/1.1"


@pytest.fixture
def folder(tmp_path):
    config = facets.load("paper")
    about = provenance.provenance_header(config, 7)
    tables.write_table(tmp_path / "poses.csv", {"tx_mm": [1.0], "yaw_mrad": [2.0], "n": [1]}, about)
    tables.write_table(tmp_path / "all.parquet", {"u_tx_um": [1.0]}, about)
    files = [tmp_path / name for name in ("poses.csv", "all.parquet", "missing.png", "run.yaml")]
    provenance.write_record(tmp_path / "run.yaml", config, 7, 1.5, {}, files)
    return tmp_path


def entities(folder):
    crate = json.loads((folder / NAME).read_text())
    return crate, {entity["@id"]: entity for entity in crate["@graph"]}


def test_a_crate_has_the_shape_of_ro_crate(folder):
    crate, by_id = entities(folder)
    assert crate["@context"][0] == f"{PROFILE}/context"
    assert len(by_id) == len(crate["@graph"])  # each entity once
    head, root = by_id.pop(NAME), by_id["./"]
    assert (head["about"], head["conformsTo"]) == ({"@id": "./"}, {"@id": PROFILE})
    assert all(root[key] for key in ("name", "description", "datePublished"))
    for entity in by_id.values():  # flat: what is referred to is an entity of its own
        for value in entity.values():
            for part in value if isinstance(value, list) else [value]:
                if isinstance(part, dict):
                    assert list(part) == ["@id"]
                    assert part["@id"] in by_id


def test_a_crate_names_the_files_and_the_units_of_columns(folder):
    _, by_id = entities(folder)
    parts = [by_id[part["@id"]] for part in by_id["./"]["hasPart"]]
    assert [part["@id"] for part in parts] == ["poses.csv", "all.parquet", "run.yaml"]
    for part in parts:
        data = (folder / part["@id"]).read_bytes()
        assert part["contentSize"] == str(len(data))
        assert part["sha256"] == hashlib.sha256(data).hexdigest()
    measured = [by_id[column["@id"]] for column in by_id["./"]["variableMeasured"]]
    assert {(column["name"], column["unitText"], column["unitCode"]) for column in measured} == {
        ("tx_mm", "mm", "mm"),
        ("yaw_mrad", "mrad", "mrad"),
        ("u_tx_um", "um", "um"),
    }
    assert by_id["#facets"]["softwareVersion"] == facets.__version__
    assert "seed 7" in by_id["#run"]["description"]


def test_a_description_by_somebody_else_stays(folder):
    config = facets.load("paper")
    for text in ('{"@graph": [{"@id": "./"}]}', "no json", "[]"):
        (folder / NAME).write_text(text)
        provenance.write_record(folder / "run.yaml", config, 7, 1.5, {}, [])
        assert (folder / NAME).read_text() == text


def test_another_program_reads_a_crate(folder):
    rocrate = pytest.importorskip("rocrate.rocrate", reason="rocrate is not installed")
    crate = rocrate.ROCrate(folder)
    assert {entity.id for entity in crate.data_entities} == {"poses.csv", "all.parquet", "run.yaml"}
    assert crate.get("#run")["instrument"].id == "#facets"
