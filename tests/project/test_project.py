"""What a stranger finds beside the code: the same facts in every file, and a whole release."""

from __future__ import annotations

import re
import subprocess
import tarfile
import tomllib
import zipfile

import pytest
from installed import ROOT, build, known_files
from packaging.requirements import Requirement
from ruamel.yaml import YAML

import facets

SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = SETTINGS["project"]
#: What packages are called on conda-forge, where it is not as on PyPI.
ON_CONDA_FORGE = {"matplotlib": "matplotlib-base"}


def yaml(name):
    return YAML(typ="safe").load((ROOT / name).read_text("utf-8"))


def test_scientific_python_s_review_finds_nothing():
    processor = pytest.importorskip("repo_review.processor")
    review = processor.process(ROOT)
    assert len(review.results) > 35
    assert [check.description for check in review.results if check.result is False] == []
    assert "ignore" not in SETTINGS["tool"].get("repo-review", {})


def test_the_version_is_the_same_everywhere():
    assert yaml("CITATION.cff")["version"] == facets.__version__
    assert yaml("recipe/recipe.yaml")["context"]["version"] == facets.__version__
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert re.search(r"^## (\S+)", changes, flags=re.MULTILINE)[1] == facets.__version__


def conda_names(texts):
    """Requirements as a recipe has them."""
    known = [Requirement(text) for text in texts]
    return {f"{ON_CONDA_FORGE.get(r.name, r.name.lower())} {r.specifier}" for r in known}


def test_the_recipe_asks_for_what_the_package_asks_for():
    asked = yaml("recipe/recipe.yaml")["requirements"]
    assert set(asked["run"][1:]) == conda_names(PROJECT["dependencies"])
    extras = ("design", "parquet", "proof", "scenes")
    texts = [text for name in extras for text in PROJECT["optional-dependencies"][name]]
    others = [text for text in texts if not text.startswith(PROJECT["name"])]
    assert set(asked["run_constraints"]) == conda_names(others)


def test_the_recipe_renders():
    rattler_build = pytest.importorskip("rattler_build")
    recipe = rattler_build.Stage0Recipe.from_file(str(ROOT / "recipe/recipe.yaml"))
    (variant,) = recipe.render(rattler_build.VariantConfig())
    assert facets.__version__ in repr(variant)


def test_workflows_run_what_the_makefile_has():
    makefile = (ROOT / "Makefile").read_text("utf-8")
    targets = dict(re.findall(r"^([a-z-]+):(.*(?:\n\t.*)*)", makefile, flags=re.MULTILINE))
    workflows = "".join(path.read_text("utf-8") for path in (ROOT / ".github/workflows").iterdir())
    called = re.findall(r"(?:run: make|target:) (.+)", workflows)
    words = set(re.findall(r"(?<![\w=-])[a-z][a-z-]*", " ".join(called)))
    assert {"unit", "lowest", "installed", "docs", "dist", "publishable"} <= words <= set(targets)
    assert "make check" in (ROOT / ".ci/run").read_text("utf-8").splitlines()
    parts = {"unit", "checked-sources", "installed", "lowest", "locked", "docs"}
    assert parts <= set(targets["check"].split())


def test_the_lock_file_names_no_other_host_than_that_of_pypi():
    text = (ROOT / "uv.lock").read_text("utf-8")
    assert set(re.findall(r"\w+://([\w.-]+)", text)) == {"pypi.org", "files.pythonhosted.org"}


def test_what_only_a_maintainer_can_fill_in_is_named_before_a_release():
    words = ["make", "--no-print-directory", "publishable"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    lacking = {line.partition(":")[0] for line in done.stdout.splitlines() if ":" in line}
    for file in ("pyproject.toml", "recipe/recipe.yaml", "paper/paper.md"):
        text = (ROOT / file).read_text("utf-8")
        assert (file in lacking) == ("OWNER/" in text or "FILL IN" in text), file
    assert bool(done.returncode) == bool(lacking - {"recipe/recipe.yaml", "paper/paper.md"})
    wrong = subprocess.run([*words, "TAG=v9.9"], cwd=ROOT, capture_output=True, check=False)
    assert wrong.returncode


@pytest.mark.slow
def test_a_release_holds_the_package_and_nothing_else(tmp_path):
    """`make dist`, as the workflow of a release runs it."""
    wheel = build(known_files(), tmp_path)
    (sdist,) = (tmp_path / "from sdist").glob("*.tar.gz")
    release = f"facets_6dof-{facets.__version__}"
    assert (wheel.name, sdist.name) == (f"{release}-py3-none-any.whl", f"{release}.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        inside = archive.namelist()
        about = archive.read(f"{release}.dist-info/METADATA").decode()
    assert {name.split("/")[0] for name in inside} == {"facets", f"{release}.dist-info"}
    assert {"facets/py.typed", f"{release}.dist-info/licenses/LICENSE"} <= set(inside)
    assert {"facets/cli/solve.py", "facets/configs/paper.yaml"} <= set(inside)
    for field in ("License-Expression: MIT", "Author: ", "Project-URL: Documentation"):
        assert f"\n{field}" in about
    with tarfile.open(sdist) as archive:
        files = [name.partition("/")[2] for name in archive.getnames()]
    assert {name.split("/")[0] for name in files if name} == {
        "LICENSE", "PKG-INFO", "README.md", "pyproject.toml", "setup.cfg",
        "cli", "configs", "experiments", "facets", "facets_6dof.egg-info",
    }  # fmt: skip
    for name in [*inside, *files]:
        assert not re.search(r"(^|/)(tests?|__pycache__|\.[a-z_]+_cache)(/|$)|\.pyc$", name), name
