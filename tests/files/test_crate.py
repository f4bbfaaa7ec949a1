"""What a folder of results says of itself to archives: the shape that RO-Crate 1.1 asks for."""

import hashlib
import json

import facets
from facets.files import provenance, write_crate, write_table


def test_a_crate_names_files_and_units_and_spares_descriptions_by_others(tmp_path):
    about = provenance.provenance_header(facets.load("paper"), 7)
    write_table(tmp_path / "poses.csv", {"tx_mm": [1.0], "u_tx_um": [2.0], "n": [1]}, about)
    crate = tmp_path / "ro-crate-metadata.json"
    for seconds in (1.0, 1.5):  # the second run replaces the first one's description
        write_crate(tmp_path, [tmp_path / "poses.csv", tmp_path / "missing.png"], about, seconds)
    content = json.loads(crate.read_text())
    profile = "https://w3id.org/ro/crate/1.1"
    assert content["@context"][0] == f"{profile}/context"
    entities = {entity["@id"]: entity for entity in content["@graph"]}
    assert len(entities) == len(content["@graph"])  # each entity once
    head, root = entities.pop(crate.name), entities["./"]
    assert (head["about"], head["conformsTo"]) == ({"@id": "./"}, {"@id": profile})
    assert all(root[key] for key in ("name", "description", "datePublished"))
    references = [each for entity in entities.values() for each in json_references(entity)]
    assert references
    assert all(set(each) == {"@id"} and each["@id"] in entities for each in references)
    (part,) = root["hasPart"]
    sha256 = hashlib.sha256((tmp_path / "poses.csv").read_bytes()).hexdigest()
    assert entities[part["@id"]]["sha256"] == sha256
    measured = [entities[column["@id"]] for column in root["variableMeasured"]]
    units = [(column["name"], column["unitText"], column["unitCode"]) for column in measured]
    assert units == [("tx_mm", "mm", "mm"), ("u_tx_um", "um", "um")]
    assert entities["#run"]["description"] == "took 1.500 s, seed 7"
    crate.write_text('{"@graph": [{"@id": "./"}]}')
    write_crate(tmp_path, [], about, 1.0)
    assert crate.read_text() == '{"@graph": [{"@id": "./"}]}'


def json_references(entity):
    for value in entity.values():
        yield from (
            each for each in ([value], value)[isinstance(value, list)] if type(each) is dict
        )
