"""Names, help texts, docstrings and pages keep the rules of docs/glossary.md and of the NumPy
standard; functions and sentences are short.

Each exception is a word with its reason.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from functools import cache

import pytest
import typer
from commands import all_commands
from facets.cli import whole_app
from installed import ROOT
from numpydoc.validate import validate

import facets

#: Folders and files whose functions, classes, arguments and constants are checked.
CHECKED = ["facets", "cli", "experiments"]
#: Names that stay, with their reason.
STAY = {
    "shipped": "a public function of facets.config",
    "ended": "a method of sources that other packages implement",
    "converged": "a public property of a solution",
    "on": "whether effects of the light are on: a question that is answered",
}

#: Words that end like participles and are none, or that the field uses as nouns.
NO_PARTICIPLES = {"speed": "a noun", "feed": "a verb"}
IRREGULAR = {
    "bent", "bought", "brought", "built", "drawn", "done", "found", "given", "gone", "grown",
    "held", "kept", "known", "laid", "led", "left", "lit", "lost", "made", "meant", "met", "paid",
    "said", "seen", "sent", "shown", "sold", "spent", "spun", "stuck", "taken", "taught",
    "thought", "told", "torn", "won", "worn", "written",
}  # fmt: skip
PREPOSITIONS = {
    "about", "above", "after", "against", "along", "among", "around", "as", "at", "before",
    "behind", "below", "beneath", "beside", "beyond", "by", "down", "during", "for", "from", "in",
    "inside", "into", "near", "of", "off", "on", "onto", "out", "outside", "over", "past",
    "since", "through", "till", "to", "towards", "under", "until", "up", "upon", "with", "within",
    "without",
}  # fmt: skip
#: Names of functions that begin with a preposition by a convention of Python.
CONVENTIONS = {"from": "alternative constructors", "to": "conversions", "as": "conversions"}
#: A name that begins so answers a question, and may end with a participle.
QUESTIONS = {"is", "are", "has", "have", "was", "were", "can", "may", "must", "uses", "needs"}

#: Characters that the list of commands has for a summary on a terminal of 80.
SUMMARY_LENGTH = 64

#: The most lines and branches of a function; at most 20 functions have more than FEW_BRANCHES.
MOST_LINES, MOST_BRANCHES, FEW_BRANCHES = 60, 15, 10

#: Words with which no help text begins: nothing stands before them that they could belong to.
NO_BEGINNING = PREPOSITIONS | {
    "and", "but", "else", "how", "if", "it", "one", "so", "that", "then", "these", "this", "which",
}  # fmt: skip


@cache
def texts(folder: str) -> dict[str, str]:
    """The files of a folder."""
    paths = sorted((ROOT / folder).rglob("*.py"))
    return {str(path.relative_to(ROOT)): path.read_text("utf-8") for path in paths}


@cache
def definitions(folder: str) -> list[tuple[str, ast.FunctionDef | ast.ClassDef]]:
    """The functions and classes of a folder, each with its place."""
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    return [
        (f"{file}:{node.lineno} {node.name}", node)
        for file, text in texts(folder).items()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, kinds)
    ]


def banned_words(heading: str) -> dict[str, str]:
    """The words in a table of the glossary, with what to say instead."""
    text = (ROOT / "docs/glossary.md").read_text("utf-8")
    section = text.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (\*[a-z *,]+\*) \| (.+?) \|", section, flags=re.MULTILINE)
    return {word: instead for words, instead in rows for word in re.findall(r"\*(.+?)\*", words)}


#: Words of no name and no help text, and words of no docstring and no page.
BANNED = banned_words("Words that no name has")
BANNED_IN_TEXTS = banned_words("Words that no text has")

#: Words with which no docstring begins: the subject would be missing.
NO_SUBJECT = r"(What|Of|That of|Those|As|Where)\b"
MOST_WORDS_IN_A_SENTENCE = 35


def words_of(name: str) -> list[str]:
    spaced = re.sub(r"([a-z])([A-Z])", r"\1_\2", name)
    return [word for word in spaced.lower().split("_") if word]


def is_participle(word: str) -> bool:
    ends = len(word) > 3 and word.endswith("ed")
    return (ends or word in IRREGULAR) and word not in NO_PARTICIPLES


def fault_of_name(name: str) -> str:
    """What is wrong with a name of any kind; "" where nothing is."""
    bad = [word for word in words_of(name) if word in BANNED]
    return f"has the word {bad[0]}; say {BANNED[bad[0]]}" if bad else ""


def fault_of_function(name: str) -> str:
    """What is wrong with a function's name; "" where nothing is."""
    words = words_of(name)
    if not words or name.startswith("__") or words[0] in QUESTIONS:
        return ""
    if is_participle(words[-1]):
        return f"ends with the participle {words[-1]}"
    if len(words) > 1 and is_participle(words[0]) and words[1] in PREPOSITIONS:
        return f"begins with the participle {words[0]}"
    if words[0] in PREPOSITIONS and not (words[0] in CONVENTIONS and len(words) > 1):
        return f"begins with the preposition {words[0]}"
    return fault_of_name(name)


@pytest.mark.parametrize("folder", CHECKED)
def test_names_are_verbs_or_nouns_of_the_field(folder):
    faults = []
    for place, node in definitions(folder):
        is_class = isinstance(node, ast.ClassDef)
        fault = (fault_of_name if is_class else fault_of_function)(node.name)
        faults += [f"{place} {fault}"] * bool(fault and node.name not in STAY)
        parts = [] if is_class else ast.walk(node)
        names = [part.arg if isinstance(part, ast.arg) else part.id for part in parts
                 if isinstance(part, ast.arg)
                 or (isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store))]  # fmt: skip
        faults += [f"{place} {name} {fault}" for name in names if (fault := fault_of_name(name))]
    assert faults == []


def test_a_class_name_exists_once():
    nodes = [node for folder in CHECKED for _, node in definitions(folder)]
    counts = Counter(node.name for node in nodes if isinstance(node, ast.ClassDef))
    assert [name for name, count in counts.items() if count > 1] == []


def body_lines(node: ast.FunctionDef) -> int:
    """The lines of a function, its docstring not counted."""
    lines = node.end_lineno - node.lineno + 1
    if ast.get_docstring(node) is None:
        return lines
    return lines - (node.body[0].end_lineno - node.body[0].lineno + 1)


def count_branches(node: ast.AST) -> int:
    """Conditions, loops and handlers in a function, and those in comprehensions; an `and` or `or`
    adds one for each of its parts but the first."""
    kinds = (ast.If, ast.For, ast.While, ast.IfExp, ast.ExceptHandler, ast.comprehension,
             ast.match_case)  # fmt: skip
    parts = list(ast.walk(node))
    more = sum(len(part.values) - 1 for part in parts if isinstance(part, ast.BoolOp))
    return more + sum(isinstance(part, kinds) for part in parts)


def test_functions_are_short():
    nodes = dict(pair for folder in CHECKED for pair in definitions(folder))
    functions = {place: node for place, node in nodes.items() if not isinstance(node, ast.ClassDef)}
    branches = {place: count_branches(node) for place, node in functions.items()}
    assert [place for place, node in functions.items() if body_lines(node) > MOST_LINES] == []
    assert [place for place, count in branches.items() if count > MOST_BRANCHES] == []
    assert sum(count > FEW_BRANCHES for count in branches.values()) <= 20


def public_functions() -> list[str]:
    values = {f"facets.{name}": getattr(facets, name) for name in facets.__all__}
    return [n for n, value in values.items() if callable(value) and not isinstance(value, type)]


#: Checks of numpydoc: a docstring, its summary, all parameters and results with a description.
NUMPYDOC = {"GL08", "SS01", "SS02", "SS03", "PR01", "PR02", "PR03", "PR07", "RT01", "RT03"}


def test_public_functions_have_docstrings_by_the_numpy_standard():
    faults = {name: [text for code, text in validate(name)["errors"] if code in NUMPYDOC]
              for name in public_functions()}  # fmt: skip
    assert {name: texts for name, texts in faults.items() if texts} == {}


def docstrings(folder: str) -> dict[str, str]:
    modules = {f"{file}:1": ast.parse(text) for file, text in texts(folder).items()}
    nodes = {**modules, **dict(definitions(folder))}
    return {place: text for place, node in nodes.items() if (text := ast.get_docstring(node))}


def pages(folder: str) -> dict[str, str]:
    """The pages of a folder, without the glossary, which explains the banned words."""
    paths = [path for path in (ROOT / folder).rglob("*.md") if path.name != "glossary.md"]
    return {str(path.relative_to(ROOT)): path.read_text("utf-8") for path in paths}


def sentences(text: str) -> list[str]:
    """The sentences of a docstring or a page, without code and formulas; of a table, each item."""
    text = re.sub(r"^\|.*", lambda row: row[0].replace("; ", " | "), text, flags=re.MULTILINE)
    text = re.sub(r"```.*?```|\$\$.*?\$\$", "\n\n", text, flags=re.DOTALL)
    text = re.sub(r"(`+).*?\1|\$[^$]*\$|\]\([^)]*\)", " 0 ", text, flags=re.DOTALL)
    parts = re.split(r"\n\s*\n|\n[^\n]*\n\s*-{3,}\n|\n\s*(?:[-*#>|:]|\d+\. )|\s\|\s", text)
    return [" ".join(sentence.split()) for part in parts
            for sentence in re.split(r"[.!?][)*]*\s+", part)]  # fmt: skip


def faults_of_text(text: str) -> list[str]:
    """The words and the sentences of a text that break the rules."""
    banned = rf"(?<!of )(?<![\w-])({'|'.join(BANNED_IN_TEXTS)})(?![\w-])"
    faults = []
    for sentence in sentences(text):
        bad = re.findall(banned, sentence.lower())
        faults += [f"has the word {word}; say {BANNED_IN_TEXTS[word]}" for word in bad]
        if len(re.findall(r"[A-Za-z][\w'-]*", sentence)) > MOST_WORDS_IN_A_SENTENCE:
            faults.append(f"is too long: {sentence}")
    return faults


@pytest.mark.parametrize("folder", CHECKED)
def test_docstrings_are_plain(folder):
    found = docstrings(folder).items()
    assert [place for place, text in found if re.match(NO_SUBJECT, text)] == []
    assert {place: faults for place, text in found if (faults := faults_of_text(text))} == {}


def test_pages_are_plain():
    found = {"README.md": (ROOT / "README.md").read_text("utf-8"), **pages("docs")}
    faults = {place: faults_of_text(text) for place, text in found.items()}
    assert {place: texts for place, texts in faults.items() if texts} == {}


def help_texts():
    for context, command in all_commands():
        yield context.command_path, command.help
        for param in command.params:
            yield f"{context.command_path} {param.opts[-1]}", param.help


def fault_of_help(text: str) -> str:
    """What is wrong with a help text; "" where nothing is."""
    plain = re.sub(r"\s*\[default: .*\]$", "", " ".join((text or "").split()))
    words = re.findall(r"[A-Za-z][\w'-]*", plain)
    if len(words) < 3:
        return "has fewer than three words"
    if words[0].lower() in NO_BEGINNING or not plain[0].isupper():
        return f"begins with {words[0]}"
    if not plain.endswith("."):
        return "ends without a full stop"
    lower = f" {' '.join(word.lower() for word in words)} "
    bad = [word for word in BANNED if f" {word} " in lower]
    return f"has the words {bad[0]}; say {BANNED[bad[0]]}" if bad else ""


def test_help_texts_stand_alone():
    faults = {place: fault for place, text in help_texts() if (fault := fault_of_help(text))}
    assert faults == {}


def test_the_list_of_commands_cuts_no_summary_short():
    app = typer.main.get_command(whole_app())
    cut = [name for name, command in app.commands.items()
           if command.get_short_help_str(SUMMARY_LENGTH).endswith("...")]  # fmt: skip
    assert cut == []


def test_options_have_no_banned_words():
    names = {place.rpartition(" ")[2].strip("-") for place, _ in help_texts()}
    assert [name for name in names if fault_of_name(name.replace("-", "_"))] == []


def test_wrong_names_and_help_texts_are_found():
    for name in ("told", "moved_by", "by_power", "of", "what_is_asked", "room"):
        assert fault_of_function(name), name
    for name in ("from_config", "has_moved", "recorded_poses"):
        assert not fault_of_function(name), name
    for text in ("Of the detector board.", "Pixels.", "Stop after this many seconds",
                 "Also write all states so many times."):  # fmt: skip
        assert fault_of_help(text), text
    assert not fault_of_help("Stop after this many seconds.  [default: never]")
    for text in ("It goes up.", "Beside\nit.", "So\nmany steps.", "word " * 36):
        assert len(faults_of_text(text)) == 1, text
    assert not faults_of_text("`told`, of course. " + "word " * 35)
