"""Pages that stand elsewhere in the repository, and links that leave the documentation.

`<!-- include: README.md -->` on a page is replaced by that file, a path from the repository's root.
A link from a page to a file outside `docs/` (the code, mostly) stays a plain link: it is right in a
repository browser, and from the folder `site/`, which stands beside `docs/`.
"""

from __future__ import annotations

import os
import re
from pathlib import Path, PurePosixPath
from typing import Any

ROOT = Path(__file__).parents[2]
#: Files outside the documentation, and the pages that show them.
SHOWN = {
    "README.md": "docs/index.md",
    "docs": "docs/index.md",
    "CONTRIBUTING.md": "docs/contributing.md",
    "experiments/README.md": "docs/claims.md",
}
#: Pages that a search lists after all others with the same words.
LISTED_LATER = ("architecture", "decisions", "fast-code", "measurements", "uniqueness")
INCLUDE = re.compile(r"<!-- include: (\S+) -->")
LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
IMAGE = re.compile(r"(!\[[^\]]*\])\(([^)\s]+)\)")
CODE = re.compile(r"(^(?:```|~~~).*?^(?:```|~~~)$)|(`[^`\n]+`)", re.DOTALL | re.MULTILINE)


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """The page with what it includes, its links made right for the place where it is shown."""
    here = PurePosixPath("docs") / page.file.src_uri
    page.meta.setdefault("search", {"boost": 0.2 if here.stem in LISTED_LATER else 1})
    text = INCLUDE.sub(lambda found: included(found[1], here.parent), markdown)
    return outside_code(text, lambda part: LINK.sub(lambda link: leaving(link, here.parent), part))


def on_page_content(html: str, *, page: Any, **_: Any) -> str:
    """A notebook's links to other pages as they are built; the builder sees to those of pages."""
    if not page.file.src_uri.endswith(".ipynb"):
        return html
    return re.sub(r'(href="[^":]+)\.(?:md|ipynb)(?=["#])', r"\1.html", html)


def outside_code(text: str, change: Any) -> str:
    """`change` made to all of the text that is neither a code block nor a code span.

    A code span may be the words of a link, so that the link is still found around it.
    """
    kept: list[str] = []

    def keep(found: re.Match[str]) -> str:
        kept.append(found[0])
        return f"\x00{len(kept) - 1}\x00"

    changed: str = change(CODE.sub(keep, text))
    return re.sub("\x00(\\d+)\x00", lambda found: kept[int(found[1])], changed)


def included(name: str, folder: PurePosixPath) -> str:
    """A file of the repository, its links rewritten so that they are right from `folder`."""
    start = PurePosixPath(name).parent

    def moved(found: re.Match[str]) -> str:
        target = found[2]
        if is_elsewhere(target):
            return found[0]
        path, mark, anchor = target.partition("#")
        there = os.path.relpath(start / path, folder)
        return f"{found[0][: found.start(2) - found.start()]}{there}{mark}{anchor})"

    text = (ROOT / name).read_text("utf-8")
    return outside_code(text, lambda part: IMAGE.sub(moved, LINK.sub(moved, part)))


def is_elsewhere(target: str) -> bool:
    return target.startswith("#") or ":" in target


def leaving(found: re.Match[str], folder: PurePosixPath) -> str:
    """A link out of `docs/` as HTML, which the builder does not follow; others as they are."""
    words, target = found[1], found[2]
    if is_elsewhere(target):
        return found[0]
    whole = PurePosixPath(os.path.normpath(folder / target.partition("#")[0]))
    if str(whole) in SHOWN:
        return f"[{words}]({os.path.relpath(SHOWN[str(whole)], folder)})"
    if whole.parts[0] == "docs" and whole.parts[1:2] not in (("firmware",), ("hooks",)):
        return found[0]
    away = os.path.relpath(whole, "site" / folder.relative_to("docs"))
    return f'<a href="{away}">{words}</a>'
