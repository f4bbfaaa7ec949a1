"""The pages as they are built: formulas, the reference of keys, pages from elsewhere."""

import re
from types import SimpleNamespace
from unittest.mock import MagicMock
from xml.etree import ElementTree

import griffe
import pytest
from pages import DOCS, PAGES, ROOT, hook

import facets
from facets.config import schema, shipped

MATHEMATICS, REFERENCE, INCLUDES = hook("mathematics"), hook("reference"), hook("includes")
RIG = hook("rig")


def page_at(name):
    return SimpleNamespace(file=SimpleNamespace(src_uri=name), meta={})


def built(text):
    """A page's formulas put in, without Markdown in between."""
    return MATHEMATICS.on_page_content(MATHEMATICS.on_page_markdown(text))


def test_every_formula_of_every_page_is_mathml():
    for page in PAGES:
        html = built(page.read_text())
        for formula in re.findall(r"<math.*?</math>", html, flags=re.DOTALL):
            ElementTree.fromstring(formula)
        alone = re.findall(r"^\$\$", page.read_text(), flags=re.MULTILINE)
        assert len(alone) == html.count('<div class="equation">'), page


def test_code_and_money_are_no_formulas():
    text = "```\n$ a $b$\n```\nIt costs 5$ or `$x$`, and $HOME too."
    assert built(text) == text


def test_an_unknown_command_stops_the_build():
    with pytest.raises(ValueError, match="not known"):
        built(r"$$\nosuchcommand x$$")


def keys(part):
    """All keys that a part of the schema names."""
    if isinstance(part, list):
        part = dict(enumerate(part))
    if isinstance(part, dict):
        yield from part.get("properties", {})
        for inner in part.values():
            yield from keys(inner)


def test_every_key_of_a_configuration_is_in_the_reference():
    text = REFERENCE.on_page_markdown((DOCS / "configuration.md").read_text())
    assert "<!-- keys" not in text
    for key in keys(schema()):
        assert f"`{key}`" in text, key


def test_a_key_has_its_meaning_its_range_and_its_default():
    text = REFERENCE.keys_of("sensor.beam")
    assert "| `power_mw` | laser power | a number above 0, up to 1000 mW | `0.3` |" in text


def test_a_quick_command_is_run_when_the_pages_are_built():
    text = REFERENCE.on_page_markdown("<!-- run: config list (first 2 lines) -->")
    lines = text.splitlines()
    assert lines[:2] == ["```console", "$ facets config list"]
    assert lines[2].split(":")[0] in shipped()
    assert lines[4:] == ["...", "```"]
    with pytest.raises(RuntimeError, match="nowhere"):
        REFERENCE.on_page_markdown("<!-- run: config show nowhere -->")


def test_every_shipped_configuration_is_described():
    text = REFERENCE.configurations()
    for name in shipped():
        (row,) = [line for line in text.splitlines() if line.startswith(f"| `{name}` |")]
        assert len(row.split("|")[2].split()) > 3, row


def test_a_page_from_elsewhere_has_its_links_made_right():
    text = INCLUDES.on_page_markdown("<!-- include: README.md -->", page=page_at("index.md"))
    assert "](gallery/rig.png)" in text
    assert "](architecture.md#where-is-what)" in text
    assert "](contributing.md)" in text
    assert '<a href="../facets/optics">' in text
    claims = INCLUDES.on_page_markdown(
        "<!-- include: experiments/README.md -->", page=page_at("claims.md")
    )
    assert "](uniqueness.md)" in claims


def test_a_link_out_of_a_folder_of_pages_is_right_in_the_site():
    text = "See [`this`](../../facets/live/sources/frames.py) and [that](../hooks/includes.py)."
    text = INCLUDES.on_page_markdown(text, page=page_at("decisions/x.md"))
    targets = re.findall(r'<a href="([^"]+)"', text)
    assert len(targets) == 2
    assert all((DOCS / "decisions" / target).resolve().exists() for target in targets)


def test_nothing_is_loaded_from_elsewhere():
    settings = (ROOT / "properdocs.yml").read_text()
    assert "http" not in settings
    assert "font: false" in settings
    for file in (DOCS / "assets").iterdir():
        assert not re.search(r"https?:", file.read_text()), file


def test_a_public_name_is_explained_once():
    pages = "".join(page.read_text() for page in (DOCS / "api").iterdir())
    names = re.findall(r"^::: (\S+)$", REFERENCE.on_page_markdown(pages), flags=re.MULTILINE)
    assert set(facets.__all__) <= {name.split(".")[-1] for name in names}
    assert len(set(names)) == len(names)


@pytest.mark.slow
def test_a_field_that_a_key_gives_shows_its_default_in_the_units_of_the_code():
    extensions = griffe.load_extensions(hook("docstrings").Docstrings)
    module = griffe.load("facets.core.sensor", extensions=extensions, search_paths=[str(ROOT)])
    noise = {field.name: str(field.default) for field in module["Noise"].parameters}
    assert noise == {"self": "None", "position": "0.0026", "at_power": "0.1", "power": "4e-05"}


def test_a_docstring_shows_arguments_as_a_list_and_examples_as_code():
    shown = hook("docstrings").shown(
        "Solves.\n\nbeam: what is known,\nin mm.  power: in mW. Returns (n,).\n\n"
        ">>> 1 + 1\n2\n\nReturns: no list."
    )
    assert "- `beam`: what is known, in mm.\n- `power`: in mW.\n- Returns (n,)." in shown
    assert "```pycon\n>>> 1 + 1\n2\n```" in shown
    assert shown.endswith("Returns: no list.")


def test_the_front_page_begins_with_a_sensor_to_play_with_and_others_can_have_one():
    text = RIG.on_page_markdown((DOCS / "index.md").read_text(), page=page_at("index.md"))
    assert '<iframe class="rig" src="rigs/paper.html?theme=light"' in text
    assert '<a href="rigs/paper.html">' in text
    assert "<!-- rig" not in text
    text = RIG.on_page_markdown("<!-- rig: paper -->", page=page_at("commands/render.md"))
    assert 'src="../rigs/paper.html?theme=light"' in text


def test_the_page_of_a_sensor_becomes_one_file_of_the_site():
    page = SimpleNamespace(content_string="<!-- rig: paper -->\n<!-- rig: paper -->")
    files = MagicMock(documentation_pages=lambda: [page])
    config = MagicMock(site_dir="site", use_directory_urls=False)
    RIG.on_files(files, config=config)
    (file,) = (call.args[0] for call in files.append.call_args_list)
    assert file.src_uri == "rigs/paper.html"
    assert "<title>paper: a three-facet-mirror sensor</title>" in file.content_string
