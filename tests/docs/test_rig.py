"""A sensor to play with on a page of the documentation."""

from __future__ import annotations

import re
from types import SimpleNamespace

from pages import DOCS, hook

RIG = hook("rig")


def page_at(name):
    return SimpleNamespace(file=SimpleNamespace(src_uri=name))


def test_the_front_page_begins_with_the_papers_sensor():
    text = RIG.on_page_markdown((DOCS / "index.md").read_text(), page=page_at("index.md"))
    assert re.search(r'<iframe class="rig" src="rigs/paper\.html\?theme=light"', text)
    assert '<a href="rigs/paper.html">' in text
    assert "<!-- rig" not in text


def test_a_page_in_a_folder_finds_it_too():
    text = RIG.on_page_markdown("<!-- rig: paper -->", page=page_at("commands/render.md"))
    assert 'src="../rigs/paper.html?theme=light"' in text


def test_the_page_becomes_a_file_of_the_site():
    class Found(list):
        def documentation_pages(self):
            return [SimpleNamespace(content_string="<!-- rig: paper -->\n<!-- rig: paper -->")]

    config = SimpleNamespace(site_dir="site", use_directory_urls=False, plugins=SimpleNamespace())
    config.plugins._current_plugin = "rig"
    (file,) = RIG.on_files(Found(), config=config)
    assert file.src_uri == "rigs/paper.html"
    assert "<title>paper: a three-facet-mirror sensor</title>" in file.content_string
