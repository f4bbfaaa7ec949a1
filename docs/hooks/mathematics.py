"""Formulas: LaTeX in the pages, MathML in what is built, which browsers draw by themselves.

`$...$` is a formula in a line, `$$...$$` one of its own; `\\tag{3}` at its end is its number.
Code is left alone. A formula travels through Markdown as a word in which Markdown sees nothing, and
takes its place in the finished page.
"""

from __future__ import annotations

import re
import unicodedata
from typing import Any

CODE = re.compile(r"^(?P<fence>```+|~~~+).*?^(?P=fence)$|`[^`\n]+`", re.DOTALL | re.MULTILINE)
DISPLAY = re.compile(r"\$\$(.+?)\$\$", re.DOTALL)
INLINE = re.compile(r"(?<![\\$\w])\$(?=\S)([^$\n]+?)(?<=\S)\$(?![\w$])")
TAG = re.compile(r"\\tag\{([^}]*)\}")
VARIANT = re.compile(r'<mi mathvariant="(bold|bold-italic)">(\w)</mi>')
#: What browsers set too wide or too high, and how it is set well: a prime, an operator's name, a
#: slash, a bar, and a minus sign that is a sign and no difference.
BETTER = [
    (re.compile(r"<msubsup>(<m[ion][^>]*>[^<]*</m[ion]>)(<m[ion][^>]*>[^<]*</m[ion]>)"
                r"<mi>&#x02032;</mi></msubsup>"),
     r'<mrow><msub>\1\2</msub><mo lspace="0" rspace="0">&#x02032;</mo></mrow>'),
    (re.compile(r"<msup>(<m[io][^>]*>[^<]*</m[io]>)<mi>&#x02032;</mi></msup>"),
     r'<mrow>\1<mo lspace="0" rspace="0">&#x02032;</mo></mrow>'),
    (re.compile(r"<mo>([a-z]{2,})</mo>"), r'<mo lspace="0.167em" rspace="0">\1</mo>'),
    (re.compile(r"<mo>&#x0002F;</mo>"), '<mo lspace="0" rspace="0">&#x0002F;</mo>'),
    (re.compile(r'<mo stretchy="false">&#x0007C;</mo>'),
     '<mo stretchy="false" lspace="0" rspace="0">&#x0007C;</mo>'),
    (re.compile(r'((?:&#x00028;|&#x0003D;|&#x0002C;)</mo>)<mo>&#x02212;</mo>'),
     r'\1<mo form="prefix" rspace="0">&#x02212;</mo>'),
]  # fmt: skip
WORD = "FORMULA{}ENDS"

_formulas: list[str] = []


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page with a word for each formula."""
    kept: list[str] = []

    def keep(found: re.Match[str]) -> str:
        kept.append(found[0])
        return f"\x00{len(kept) - 1}\x00"

    text = CODE.sub(keep, markdown)
    text = DISPLAY.sub(lambda found: word(display(found[1].strip())), text)
    text = INLINE.sub(lambda found: word(mathml(found[1], "inline")), text)
    return re.sub("\x00(\\d+)\x00", lambda found: kept[int(found[1])], text)


def on_page_content(html: str, **_: Any) -> str:
    """The page with each formula in its place."""
    block = re.compile("<p>\\s*" + WORD.format(r"(\d+)") + "\\s*</p>")
    html = block.sub(lambda found: _formulas[int(found[1])], html)
    return re.sub(WORD.format(r"(\d+)"), lambda found: _formulas[int(found[1])], html)


def word(formula: str) -> str:
    _formulas.append(formula)
    return WORD.format(len(_formulas) - 1)


def display(latex: str) -> str:
    """A formula of its own, with its number beside it where it has one."""
    tag = TAG.search(latex)
    formula = mathml(TAG.sub("", latex).strip(), "block")
    number = f'<span class="equation-number">({tag[1]})</span>' if tag else ""
    return f'<div class="equation">{formula}{number}</div>'


def mathml(latex: str, kind: str) -> str:
    """MathML of a formula; an error where a command of it is not known."""
    from latex2mathml.converter import convert

    found: str = convert(latex, display=kind)
    if "\\" in found or re.search(r"<mi>&(amp;)?</mi>", found):
        raise ValueError(f"a command in this formula is not known: {latex}")
    for pattern, better in BETTER:
        found = pattern.sub(better, found)
    return VARIANT.sub(upright_bold, found)


def upright_bold(found: re.Match[str]) -> str:
    """A bold letter from Unicode's mathematical alphabets: browsers know no other in a formula."""
    variant, letter = found.groups()
    if letter.isascii() and letter.isalpha():
        case = "CAPITAL" if letter.isupper() else "SMALL"
        style = variant.upper().replace("-", " ")
        letter = unicodedata.lookup(f"MATHEMATICAL {style} {case} {letter.upper()}")
    return f'<mi mathvariant="normal">{letter}</mi>'
