"""Every command on every page is one that the program takes; every command has a page."""

import importlib.util
import re
import shlex

import pytest
from pages import DOCS, PAGES, ROOT, blocks, hook, prose

REFERENCE = hook("reference")


def lines(page, start):
    """What is to be typed on a page: the lines that begin so in `bash`, or after `$ ` elsewhere."""
    typed = [line for text in blocks(page, "bash") for line in text.splitlines()]
    shown = [line for text in blocks(page, "console", "text", "") for line in text.splitlines()]
    typed += [line.removeprefix("$ ") for line in shown if line.startswith(("$ ", "make "))]
    return [line for line in typed if line.startswith(start)]


def parse(line):
    """Parsed as the program would, without running anything; SystemExit or an error if wrong."""
    words = shlex.split(line.partition(" > ")[0], comments=True)[1:]
    depth = 2 if words[0] == "config" else 1
    command, _ = REFERENCE.command_of(" ".join(words[:depth]))
    return command.make_context(words[depth - 1], words[depth:])


def test_each_command_in_a_block_is_parsed():
    typed = {line for page in PAGES for line in lines(page, "facets ")}
    assert len(typed) > 30
    for line in typed:
        assert parse(line).info_name, line
    with pytest.raises(Exception, match="nonsense"):
        parse("facets solve paper readings.csv -o poses.csv --nonsense")


def test_each_command_in_a_sentence_exists_with_its_options():
    spans = {span for page in PAGES for span in re.findall(r"`(facets [a-z][^`]*)`", prose(page))}
    assert len(spans) > 30
    for span in spans:
        words = span.split()[1:]
        depth = 2 if words[0] == "config" and len(words) > 1 else 1
        command, _ = REFERENCE.command_of(" ".join(words[:depth]))
        options = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words[depth:] if word[0] == "-"} <= options | {"--help"}, span


def test_modules_to_be_run_and_targets_to_be_made_exist():
    rules = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    for page in PAGES:
        for module in re.findall(r"python -m (facets\.[\w.]+)", page.read_text()):
            assert importlib.util.find_spec(module), module
        typed = [line.split()[1] for line in lines(page, "make ") if line[5] != "-"]
        assert {*re.findall(r"`make (\w+)`", prose(page)), *typed} <= set(rules), page


@pytest.mark.parametrize("name", REFERENCE.command_names())
def test_every_command_has_a_page_with_its_help(name):
    page = DOCS / "commands" / f"{name.split()[0]}.md"
    assert f"<!-- help: {name} -->" in page.read_text()
    built = REFERENCE.on_page_markdown(page.read_text())
    assert f"Usage: facets {name}" in built


def test_the_index_of_commands_names_each():
    index = (DOCS / "commands" / "index.md").read_text()
    for name in REFERENCE.command_names():
        assert f"[`facets {name.split()[0]}`]({name.split()[0]}.md)" in index
