"""Draws the folders of the code and the arrows between them: `docs/packages.svg`.

    python -m facets.experiments.studies.draw_packages docs/packages.svg

Folders and arrows are read from the imports, those for type checkers included; the layers are those
of the contract in `.importlinter`. An arrow from one folder to another says that some file of the
first imports some file of the second. Dark arrows are those that no other way implies: the rest,
drawn light, only shorten a way along dark ones.
"""

from __future__ import annotations

import configparser
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAMS = ("cli", "experiments")
#: `configs` holds no code, and `__main__`, which is no folder, only starts the program.
NOT_DRAWN = ("configs", "__main__")

Arrow = tuple[str, str]
Place = tuple[float, float]

#: The drawing's measures, in pixels.
WIDTH, ROW, BOX_WIDTH, BOX_HEIGHT, TOP = 1040, 92, 128, 34, 24
DARK, LIGHT, INK = "#2f5d8a", "#cfd6dd", "#1d2733"


def layers() -> list[list[str]]:
    """The folders by layer, from the top, as the contract has them, less those without an arrow."""
    contract = configparser.ConfigParser()
    if not contract.read(ROOT / ".importlinter"):
        raise SystemExit("draw_packages draws the folders of a checkout: run it in one")
    lines = contract["importlinter:contract:layers"]["layers"].splitlines()
    rows = [[name for name in re.findall(r"\w+", line) if name not in NOT_DRAWN] for line in lines]
    return [row for row in rows if row]


def folder_of(module: str) -> str:
    """The folder in which a module lies; nothing for the face of the package, `facets` itself."""
    words = module.split(".")
    if words[0] == "facets":
        words = words[1:]
    return words[0] if words else ""


def arrows() -> set[Arrow]:
    """Pairs (from, to) of folders of which the first imports the second."""
    import grimp

    sys.path.insert(0, str(ROOT))
    try:
        graph = grimp.build_graph("facets", *PROGRAMS, include_external_packages=True)
    finally:
        sys.path.remove(str(ROOT))
    imports = package_imports()
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            imports.add((folder_of(module), folder_of(other)))
    known = {name for row in layers() for name in row}
    return {(a, b) for a, b in imports if a != b and a in known and b in known}


def package_imports() -> set[Arrow]:
    """Find the imports of one program from another by their common installed name."""
    return {
        (program, other)
        for program in PROGRAMS
        for file in (ROOT / program).rglob("*.py")
        for other in re.findall(r"^\s*from facets\.(\w+)", file.read_text("utf-8"), re.MULTILINE)
        if other in PROGRAMS
    }


def plain_arrows(every: set[Arrow]) -> set[Arrow]:
    """The arrows that no way over other folders implies (the transitive reduction)."""
    return {(a, b) for a, b in every if not reaches(a, b, every - {(a, b)})}


def reaches(start: str, end: str, every: set[Arrow]) -> bool:
    seen, waiting = set(), [start]
    while waiting:
        here = waiting.pop()
        if here == end:
            return True
        if here not in seen:
            seen.add(here)
            waiting += [b for a, b in every if a == here]
    return False


def places(rows: list[list[str]], every: set[Arrow]) -> dict[str, Place]:
    """Centre of each folder's box: in its layer's row, near the folders that arrows connect."""
    x = {name: WIDTH * (n + 0.5) / len(row) for row in rows for n, name in enumerate(row)}
    for _ in range(8):
        for row in rows:
            wish = {name: mean_beside(name, every, x) for name in row}
            for n, name in enumerate(sorted(row, key=lambda name: (wish[name], name))):
                x[name] = WIDTH * (n + 0.5) / len(row)
    y = {name: TOP + n * ROW + BOX_HEIGHT / 2 for n, row in enumerate(rows) for name in row}
    return {name: (x[name], y[name]) for name in x}


def mean_beside(name: str, every: set[Arrow], x: dict[str, float]) -> float:
    beside = [x[b if a == name else a] for a, b in every if name in (a, b)]
    return sum(beside) / len(beside) if beside else WIDTH / 2


def drawing() -> str:
    """Make the drawing as SVG. Each arrow carries `data-from` and `data-to`."""
    rows, every = layers(), arrows()
    plain = plain_arrows(every)
    at = places(rows, plain)
    height = TOP + (len(rows) - 1) * ROW + BOX_HEIGHT + 34
    parts = [*head(height)]
    parts += [curve(arrow, at, LIGHT, 1.0) for arrow in sorted(every - plain)]
    parts += [curve(arrow, at, DARK, 1.6) for arrow in sorted(plain)]
    parts += [box(name, at[name]) for row in rows for name in row]
    words = "An arrow: a file here imports a file there. Light: implied by a way along dark arrows."
    parts.append(f'<text x="{WIDTH / 2}" y="{height - 8}" class="note">{words}</text>')
    return "\n".join([*parts, "</svg>", ""])


def head(height: float) -> Iterator[str]:
    yield (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" '
        f'width="{WIDTH}" height="{height:g}" role="img">'
    )
    yield "<title>The folders of the code and the imports between them</title>"
    yield (
        f"<style>text {{ font: 15px sans-serif; text-anchor: middle; fill: {INK} }} "
        ".note { font-size: 13px }</style>"
    )
    for colour, name in ((DARK, "dark"), (LIGHT, "light")):
        yield (
            f'<marker id="{name}" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
            f'markerHeight="7" markerUnits="userSpaceOnUse" orient="auto">'
            f'<path d="M0,1 L8,4 L0,7 z" fill="{colour}"/></marker>'
        )
    yield f'<rect width="{WIDTH}" height="{height:g}" fill="white"/>'


def curve(arrow: Arrow, at: dict[str, Place], colour: str, width: float) -> str:
    """Curve from the lower edge of a box to the upper edge of another."""
    (x0, y0), (x1, y1) = at[arrow[0]], at[arrow[1]]
    lean = max(-0.38, min(0.38, (x1 - x0) / WIDTH)) * BOX_WIDTH
    begin, end = (x0 + lean, y0 + BOX_HEIGHT / 2), (x1 - lean, y1 - BOX_HEIGHT / 2)
    bend = 0.45 * (end[1] - begin[1])
    path = (
        f"M{begin[0]:.1f},{begin[1]:.1f} C{begin[0]:.1f},{begin[1] + bend:.1f} "
        f"{end[0]:.1f},{end[1] - bend:.1f} {end[0]:.1f},{end[1]:.1f}"
    )
    head = "dark" if colour == DARK else "light"
    return (
        f'<path data-from="{arrow[0]}" data-to="{arrow[1]}" d="{path}" fill="none" '
        f'stroke="{colour}" stroke-width="{width}" marker-end="url(#{head})"/>'
    )


def box(name: str, at: Place) -> str:
    x, y = at[0] - BOX_WIDTH / 2, at[1] - BOX_HEIGHT / 2
    fill = "#fdf3e1" if name in PROGRAMS else "#eef4fa"
    return (
        f'<g id="{name}"><rect x="{x:.1f}" y="{y:.1f}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}" '
        f'rx="7" fill="{fill}" stroke="{DARK}"/>'
        f'<text x="{at[0]:.1f}" y="{at[1] + 5:.1f}">{name}</text></g>'
    )


def arrows_of(svg: str) -> set[Arrow]:
    """The arrows that a drawing shows."""
    return set(re.findall(r'data-from="(\w+)" data-to="(\w+)"', svg))


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(drawing(), "utf-8")
