"""What the documentation tells people to write and run works, and its links lead somewhere."""

import json
import os
import re
import subprocess
import sys
import tomllib

import pytest
from pages import DOCS, GUIDES, LINK, PAGES, ROOT, blocks, hook, links, name_of, prose

import facets

NOTEBOOKS = sorted(DOCS.rglob("*.ipynb"))
#: The Python of the pages that are not followed as guides.
WRITTEN = [(page, text) for page in PAGES if page not in GUIDES for text in blocks(page, "python")]


@pytest.mark.installed
@pytest.mark.parametrize("page", [page for page in PAGES if page not in GUIDES], ids=name_of)
def test_configurations_in_the_text_load(page, tmp_path):
    for n, text in enumerate(blocks(page, "yaml")):
        path = tmp_path / f"{n}.yaml"
        path.write_text(text)
        facets.load(path)


@pytest.mark.installed
@pytest.mark.parametrize(("page", "text"), WRITTEN, ids=lambda value: getattr(value, "stem", ""))
def test_python_in_the_text_runs(page, text):
    exec(compile(text, name_of(page), "exec"), {})


def anchors(page):
    """The anchors of a page: those of its headings as the builder makes them, and its own."""
    from markdown.extensions.toc import slugify

    text = prose(page)
    if found := re.search(r"<!-- include: (\S+) -->", text):
        return anchors(ROOT / found[1])
    if "<!-- keys -->" in text:
        text += "\n" + hook("reference").all_keys()
    headings = re.findall(r"^#+ +(.+)$", text, flags=re.MULTILINE)
    named = re.findall(r'<a id="([^"]+)">', text)
    return {slugify(heading.replace("`", ""), "-") for heading in headings} | set(named)


def follow(links, page):
    """Look for the file and the heading that each link of a page means."""
    for link in links:
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_leads_somewhere(page):
    follow(links(page), page)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=name_of)
def test_a_notebook_is_kept_without_results_and_its_links_lead_somewhere(path):
    """Building the documentation runs it, and fails where it fails."""
    cells = json.loads(path.read_text("utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)
    for cell in cells:
        if cell["cell_type"] == "markdown":
            follow(LINK.findall("".join(cell["source"])), path)


@pytest.mark.slow
def test_ten_tasks_of_a_day_run_and_have_five_lines_at_most(tmp_path):
    """In a home of their own, where PyMoDAQ puts its settings."""
    notebook = json.loads((DOCS / "notebooks/a-day-in-the-laboratory.ipynb").read_text("utf-8"))
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    titles = [c for c in notebook["cells"] if re.match(r"## \d", "".join(c["source"]))]
    assert len(titles) == 10
    assert max(len([line for line in cell.splitlines() if line]) for cell in cells[1:]) <= 5
    code = "\n".join(cells).replace("%matplotlib inline", "")
    home = {**os.environ, "HOME": str(tmp_path), "MPLBACKEND": "agg"}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=home, check=True)


def test_every_page_is_in_the_menu():
    menu = (ROOT / "properdocs.yml").read_text()
    for page in [*DOCS.rglob("*.md"), *NOTEBOOKS]:
        assert str(page.relative_to(DOCS)) in menu, page


def test_the_figures_of_the_readme_are_those_of_the_full_tables():
    """So that a new measurement is not told in one place alone."""
    number = re.compile(r"\d[\d.,]*(?:e[-+]?\d+)?")
    tables = re.sub(
        r"\n## What is neglected.*?(?=\n## |$)",
        "",
        (DOCS / "measurements.md").read_text(),
        flags=re.S,
    )
    whole = {figure.rstrip(",.") for figure in number.findall(tables)}
    section = prose(ROOT / "README.md").split("## How exact, how fast")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", section, flags=re.MULTILINE)[2:]
    assert len(rows) == 11
    for what, figures in rows:
        for figure in number.findall(figures):
            assert figure.rstrip(",.") in whole, (what, figure)


def test_both_maps_name_every_folder():
    for page in (ROOT / "README.md", DOCS / "architecture.md"):
        text = page.read_text()
        for folder in (ROOT / "facets").iterdir():
            if (folder / "__init__.py").exists():
                assert f"facets/{folder.name})" in text, (page.name, folder.name)


def test_the_glossary_explains_every_status():
    text = (DOCS / "glossary.md").read_text()
    for status in facets.Status:
        assert f"| {status.label} |" in text, status


def test_the_readme_installs_this_version_with_extras_that_there_are():
    pattern = r'pip install "(\w+)-([\d.]+)-py3-none-any.whl\[([\w,]+)\]'
    name, version, extras = re.search(pattern, (ROOT / "README.md").read_text()).groups()
    about = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (name, version) == (about["name"].replace("-", "_"), facets.__version__)
    assert set(extras.split(",")) <= set(about["optional-dependencies"])
