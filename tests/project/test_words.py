"""Names, help texts and docstrings keep the rules of docs/glossary.md and of the NumPy standard;
functions are short.

Each exception is a word with its reason.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
import typer
from facets.cli import manual, whole_app
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
#: Faces whose public functions have docstrings by the NumPy standard.
FACES: list[str] = []

#: Words that end like participles and are none, or that the field uses as nouns.
NO_PARTICIPLES = {
    "shared": "an adjective: memory, parts",
    "need": "a verb and a noun",
    "seed": "a noun: of random numbers",
    "speed": "a noun",
    "embed": "a verb",
    "feed": "a verb",
    "exceed": "a verb",
    "proceed": "a verb",
    "fixed": "an adjective",
    "open": "a verb",
    "listen": "a verb",
    "screen": "a verb and a noun",
    "token": "a noun",
    "then": "no verb",
    "between": "no verb",
    "when": "no verb",
    "golden": "an adjective",
    "tighten": "a verb",
    "widen": "a verb",
    "straighten": "a verb",
    "len": "a noun: length",
}
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

#: Units in the comment of a constant, and how its name then ends.
UNITS = {
    r"s|seconds?": "S", r"ms|milliseconds?": "MS", r"mm": "MM", r"µm|um": "UM", r"rad": "RAD",
    r"mrad": "MRAD", r"µrad|urad": "URAD", r"Hz": "HZ", r"mW": "MW", r"µW|uW": "UW",
    r"bytes": "BYTES", r"degrees": "DEG", r"per cent|%": "PERCENT",
}  # fmt: skip

#: Words with which no help text begins: nothing stands before them that they could belong to.
NO_BEGINNING = PREPOSITIONS | {
    "and", "but", "else", "how", "if", "it", "one", "so", "that", "then", "these", "this", "which",
}  # fmt: skip


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def trees(folder: str) -> list[tuple[str, ast.Module]]:
    path = ROOT / folder
    paths = sorted(path.rglob("*.py")) if path.is_dir() else [path]
    return [(str(p.relative_to(ROOT)), tree_of(p)) for p in paths]


def banned_words() -> dict[str, str]:
    """The words that no name and no help text has, with what to say instead, from the glossary."""
    text = (ROOT / "docs/glossary.md").read_text("utf-8")
    _, _, section = text.partition("## Words that no name has")
    rows = re.findall(r"^\| \*([a-z ]+)\* \| (.+?) \|", section, flags=re.MULTILINE)
    return dict(rows)


BANNED = banned_words()


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


def functions_and_classes(folder: str):
    for file, tree in trees(folder):
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                yield f"{file}:{node.lineno}", node


@pytest.mark.parametrize("folder", CHECKED)
def test_names_are_verbs_or_nouns_of_the_field(folder):
    faults = []
    for place, node in functions_and_classes(folder):
        is_class = isinstance(node, ast.ClassDef)
        fault = (fault_of_name if is_class else fault_of_function)(node.name)
        fault = "" if node.name in STAY else fault
        faults += [f"{place} {node.name} {fault}"] * bool(fault)
        every = [] if is_class else ast.walk(node.args)
        names = [one.arg for one in every if isinstance(one, ast.arg)]
        faults += [f"{place} {name} {fault}" for name in names if (fault := fault_of_name(name))]
    assert faults == []


def test_a_class_name_exists_once():
    places = defaultdict(set)
    for folder in CHECKED:
        for place, node in functions_and_classes(folder):
            if isinstance(node, ast.ClassDef):
                places[node.name].add(place)
    assert {name: sorted(where) for name, where in places.items() if len(where) > 1} == {}


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
    functions = [(place, node) for folder in ("facets", "cli", "experiments")
                 for place, node in functions_and_classes(folder)
                 if not isinstance(node, ast.ClassDef)]  # fmt: skip
    lines = {f"{place} {node.name}": body_lines(node) for place, node in functions}
    branches = {f"{place} {node.name}": count_branches(node) for place, node in functions}
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}
    assert {name: count for name, count in branches.items() if count > MOST_BRANCHES} == {}
    assert len([name for name, count in branches.items() if count > FEW_BRANCHES]) <= 20


def test_branches_are_counted():
    text = "def f(x):\n    'Of x.'\n    for y in x:\n        if y and x or y:\n            pass\n"
    node = ast.parse(text).body[0]
    assert (body_lines(node), count_branches(node)) == (4, 4)


def is_numeric(value: ast.expr) -> bool:
    """Whether an expression is made of numbers alone."""
    allowed = (ast.Constant | ast.Tuple | ast.UnaryOp | ast.BinOp | ast.operator | ast.unaryop
               | ast.Load)  # fmt: skip
    return all(
        isinstance(part, allowed) and isinstance(getattr(part, "value", 0), int | float)
        for part in ast.walk(value)
    )


def constants(text: str):
    """The numeric constants of a module, each with the comment above or beside it."""
    lines = text.splitlines()
    for node in ast.parse(text).body:
        if not isinstance(node, ast.Assign) or not is_numeric(node.value):
            continue
        first, comment = node.lineno - 2, lines[node.lineno - 1].partition("#")[2]
        while first >= 0 and lines[first].startswith("#"):
            comment, first = f"{lines[first]} {comment}", first - 1
        targets = [one for part in node.targets for one in ast.walk(part)]
        for target in targets:
            if isinstance(target, ast.Name) and target.id.isupper():
                yield target.id, comment


@pytest.mark.parametrize("folder", CHECKED)
def test_a_constant_with_a_unit_has_it_in_its_name(folder):
    faults = []
    for file, _ in trees(folder):
        for name, comment in constants((ROOT / file).read_text("utf-8")):
            units = {ending for pattern, ending in UNITS.items()
                     if re.search(rf"(?<![\w`'])(?:{pattern})(?![\w`])", comment)}  # fmt: skip
            if units and not any(ending in name.split("_") for ending in UNITS.values()):
                faults.append(f"{file} {name}: its comment says {units}")
    assert faults == []


def test_constants_and_their_units_are_found():
    found = list(constants("#: Time between two tries, s.\nAGAIN = 0.2\nNAMES = ('a', 'b')\n"))
    assert found == [("AGAIN", "#: Time between two tries, s. ")]


def public_functions():
    names = [("facets", name) for name in facets.__all__]
    for face in FACES:
        names += [(face, name) for name in import_module(face).__all__]
    for face, name in names:
        value = getattr(import_module(face), name)
        if callable(value) and not isinstance(value, type):
            yield f"{face}.{name}"


#: Checks of numpydoc: a docstring, its summary, all parameters and results with a description.
NUMPYDOC = {"GL08", "SS01", "SS02", "SS03", "PR01", "PR02", "PR03", "PR07", "RT01", "RT03"}


def test_public_functions_have_docstrings_by_the_numpy_standard():
    faults = {name: [text for code, text in validate(name)["errors"] if code in NUMPYDOC]
              for name in public_functions()}  # fmt: skip
    assert {name: texts for name, texts in faults.items() if texts} == {}


def help_texts():
    app = typer.main.get_command(whole_app())
    for context, command in manual.commands(app, manual.context_of(app, "facets", None)):
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
    faults = {name: fault_of_name(name.replace("-", "_")) for name in names}
    assert {name: fault for name, fault in faults.items() if fault} == {}


@pytest.mark.parametrize(
    ("name", "fault"),
    [("told", "participle"), ("rows_kept", "participle"), ("moved_by", "participle"),
     ("by_power", "preposition"), ("of", "preposition"), ("from_config", ""), ("seed", ""),
     ("simplify_sum", ""), ("is_open", ""), ("has_moved", ""), ("recorded_poses", ""),
     ("what_is_asked", "participle"), ("room", "say")],
)  # fmt: skip
def test_wrong_names_are_found(name, fault):
    assert fault in fault_of_function(name)
    assert bool(fault) == bool(fault_of_function(name))


@pytest.mark.parametrize(
    ("text", "fault"),
    [("Of the detector board.", "begins with Of"), ("Then it ends.", "begins with Then"),
     ("Pixels.", "fewer"), ("Stop after this many seconds", "full stop"),
     ("Stop after this many seconds.  [default: never]", ""),
     ("Also write all states so many times.", "so many")],
)  # fmt: skip
def test_wrong_help_texts_are_found(text, fault):
    assert fault in fault_of_help(text)
    assert bool(fault) == bool(fault_of_help(text))


def test_the_glossary_has_the_list():
    assert {"room", "told", "asked", "so many"} <= BANNED.keys()
