"""Pages of the documentation, their contents, and the hooks that build them."""

import importlib.util
import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "experiments" / "README.md",
    *sorted(DOCS.rglob("*.md")),
]
LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^)\s]+)\)")
GUIDES = [
    DOCS / f"{name}.md"
    for name in ("experimenters", "designers", "doubters", "answers", "data-frames")
]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def name_of(page):
    return str(page.relative_to(ROOT))


def blocks(page, *languages):
    """The code blocks of a page in these languages; "" for those that name none."""
    return [text for language, text in FENCE.findall(page.read_text()) if language in languages]


@dataclass(frozen=True)
class Step:
    """A code block of a page, with the text since the block before it."""

    text: str
    language: str
    block: str

    @property
    def file(self):
        """The configuration's file, which is the last one that the text names."""
        return re.findall(r"`([\w-]+\.yaml)`", self.text)[-1]


def steps(page):
    """List the blocks of a page in order; the text after the last block is a step without one."""
    text, *others = FENCE.split(page.read_text())
    found = []
    for language, block, after in zip(*(others[n::3] for n in range(3)), strict=True):
        found.append(Step(text, language, block))
        text = after
    return [*found, Step(text, "", "")]


def shape(line):
    """Strip numbers, letters of detectors and widths of columns from a printed line.

    Rounding decides which of several equivalent detectors is named.
    """
    line = re.sub(r"\bPSD [ABC]\b", "PSD", line)
    return " ".join(re.sub(r"[-+±]*\d[\d.,]*(e[-+]?\d+)?", "#", line).split())


#: A number, unless it is a time: how long a command takes is another on each computer.
NUMBER = re.compile(r"\d[\d,]*\.?\d*(?:e[-+]?\d+)?(?![\d.,e]*(?: m?s\b|\d))")


def agree(shown, printed, share):
    """Whether the numbers of two lines of one shape agree to a share of the smaller one, or to two
    units in the last place of the shown one; what follows `...` is not compared."""
    for one, other in zip(
        NUMBER.findall(shown.partition("...")[0]), NUMBER.findall(printed), strict=False
    ):
        a, b = (float(text.replace(",", "").rstrip(".")) for text in (one, other))
        unit = 10.0 ** -len(one.partition(".")[2].partition("e")[0])
        if abs(a - b) > max(share * min(abs(a), abs(b)), 2 * unit if "e" not in one else 0.0):
            return False
    return True


def prose(page):
    """Remove the code blocks of a page."""
    return FENCE.sub("", page.read_text())


def links(page):
    """List the targets of a page's links and pictures, except those on other sites."""
    return [link for link in LINK.findall(prose(page)) if ":" not in link]


def hook(name):
    """Load a module of `docs/hooks` in the same way as the builder."""
    spec = importlib.util.spec_from_file_location(f"hooks_{name}", DOCS / "hooks" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
