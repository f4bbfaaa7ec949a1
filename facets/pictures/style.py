"""The style of all plots (sizes, lines, fonts and colours), and the writing of their files.

A picture is at most `FULL` inches wide and has no text below `LEAST` points, so that it remains
legible at the width of a printed column, 88 mm. Text stays text: SVG has it as such, PDF by an
embedded TrueType font.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.hues import chosen_hues, chosen_style
from ..core.units import Floats, Integers, unit_of as unit_of
from ..files.tables import Whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Widths of a picture with one panel and of one as wide as a page's text, inches.
SINGLE, FULL = 4.4, 6.2
#: Sizes of text, points: minimum, and labels.
LEAST, LABEL_SIZE = 9.0, 9.5
ENDINGS = (".png", ".svg", ".pdf")
#: Dots per inch of PNGs by style, and of rasterised parts of SVG and PDF.
DOTS = {"paper": 300, "screen": 160, "dark": 160}
VECTOR_DOTS = 300
#: Points per inch, the unit of lengths in SVG and PDF.
VECTOR_DPI = 72
#: Widths of lines of data, and of axes and grids, by style; points.
LINES = {"paper": (1.1, 0.6), "screen": (1.4, 0.7), "dark": (1.4, 0.7)}
#: Metadata without a date, so that the same picture gives the same file.
METADATA: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}

#: Axes in words.
WORDS = {
    "tx": "shift in x", "ty": "shift in y", "tz": "shift in z", "roll": "roll", "pitch": "pitch",
    "yaw": "yaw", "bx": "beam in x", "by": "beam in y",
}  # fmt: skip


def rules() -> dict[Any, Any]:
    """Return matplotlib's settings for the chosen style.

    They are matplotlib's defaults with those of the project, whatever the user's settings are.
    """
    from matplotlib import rcParamsDefault

    hues, (line, thin) = chosen_hues(), LINES[chosen_style()]
    defaults = {name: value for name, value in rcParamsDefault.items() if name != "backend"}
    return defaults | {
        "axes.axisbelow": True,
        "axes.edgecolor": hues.soft,
        "axes.facecolor": hues.ground,
        "axes.grid": True,
        "axes.labelcolor": hues.ink,
        "axes.labelsize": LABEL_SIZE,
        "axes.linewidth": thin,
        "axes.spines.right": False,
        "axes.spines.top": False,
        "axes.titlelocation": "left",
        "axes.titlesize": LABEL_SIZE,
        "axes.titleweight": "bold",
        "axes.unicode_minus": True,
        "figure.facecolor": hues.ground,
        "figure.titlesize": 10.5,
        "font.family": "sans-serif",
        "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "Helvetica", "sans-serif"],
        "font.size": LABEL_SIZE,
        "grid.color": hues.rule,
        "grid.linewidth": thin,
        "hatch.color": hues.ink,
        "legend.fontsize": LEAST,
        "legend.frameon": False,
        "legend.handlelength": 1.6,
        "lines.linewidth": line,
        "pdf.fonttype": 42,
        "ps.fonttype": 42,
        "savefig.facecolor": hues.ground,
        "svg.fonttype": "none",
        "svg.hashsalt": "facets",
        "text.color": hues.ink,
        "xtick.color": hues.soft,
        "xtick.labelcolor": hues.ink,
        "xtick.labelsize": LEAST,
        "ytick.color": hues.soft,
        "ytick.labelcolor": hues.ink,
        "ytick.labelsize": LEAST,
    }


@contextmanager
def style_context(**changes: Any) -> Iterator[None]:
    """Apply the chosen style to the pictures drawn in this context.

    changes: further settings of matplotlib, with two underscores for a dot: `axes__grid=False`.
    """
    import matplotlib as mpl

    more: dict[Any, Any] = {name.replace("__", "."): value for name, value in changes.items()}
    with mpl.rc_context({**rules(), **more}):
        yield


def figure(width: float, height: float, **options: Any) -> Figure:
    """Make an empty figure in the project's style; sizes in inches."""
    from matplotlib.figure import Figure

    with style_context():
        return Figure(figsize=(width, height), **{"layout": "constrained", **options})


def save(picture: Figure, path: Path) -> None:
    """Write a picture as PNG, SVG or PDF by its ending. Raises `InputError` for another ending,
    and `OutputError`, without a partial file, if writing fails."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{path}: a picture's name ends in {', '.join(ENDINGS)}")
    kind = path.suffix[1:].lower()
    with style_context(), Whole(path) as temporary:
        flat, dots = kind == "png", DOTS[chosen_style()]
        lay_out(picture, dots if flat else VECTOR_DPI)
        picture.savefig(temporary, format=kind, dpi=dots if flat else VECTOR_DOTS,
                        metadata=METADATA.get(kind))  # fmt: skip


def svg_text(picture: Figure) -> str:
    """Convert a picture to an SVG element of a page."""
    from io import StringIO

    stream = StringIO()
    with style_context():
        lay_out(picture, VECTOR_DPI)
        picture.savefig(stream, format="svg", dpi=VECTOR_DOTS, metadata=METADATA["svg"])
    text = stream.getvalue()
    return text[text.index("<svg") :]


def lay_out(picture: Figure, dpi: int) -> None:
    """Arrange the parts of a picture once.

    Saving would also do so, but would draw the picture twice.
    """
    picture.set_dpi(dpi)
    layout = picture.get_layout_engine()
    if layout is not None:
        layout.execute(picture)
        picture.set_layout_engine("none")


def ramp() -> Any:
    """Return a colour map whose ends contrast with the ground."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    ends = (0.2, 1.0) if chosen_style() == "dark" else (0.0, 0.92)
    return ListedColormap(colormaps["viridis"](np.linspace(*ends, 256)))


def component_label(name: str) -> str:
    """Name a component of the state: "shift in x"."""
    return WORDS[name]


def place_label(name: str) -> str:
    """Label positions along an axis: "shift in x, mm"."""
    return f"{WORDS[name]}, {unit_of(name).unit}"


def fine_label(name: str) -> str:
    """Label errors and uncertainties along an axis: "shift in x, µm"."""
    return f"{WORDS[name]}, {unit_of(name).fine_unit}"


class Band(NamedTuple):
    """Many samples in columns: minimum, maximum and median of each."""

    time: Floats
    low: Floats
    high: Floats
    middle: Floats


def band(time: Floats, values: Floats, columns: int | Integers = 120) -> Band:
    """Compute minimum, maximum and median of the samples in each column of a panel.

    time, values: (n,), time ascending; NaN are ignored.  columns: number of equal columns, or the
    first sample of each but the first.  A column without a number is NaN, so that it is a gap.
    """
    parts = np.array_split(np.arange(len(time)), np.minimum(columns, len(time)))
    rows = [(time[part].mean(), *ends(values[part])) for part in parts]
    return Band(*np.array(rows).reshape(-1, 4).T)


def ends(values: Floats) -> tuple[float, float, float]:
    finite = values[np.isfinite(values)]
    if not len(finite):
        return (np.nan, np.nan, np.nan)
    return float(finite.min()), float(finite.max()), float(np.median(finite))


def say(panel: Axes, text: str) -> None:
    """Write in an empty panel why it is empty."""
    panel.text(0.5, 0.5, text, ha="center", va="center", transform=panel.transAxes,
               color=chosen_hues().soft, fontsize=LEAST, wrap=True)  # fmt: skip


def panels_legend(picture: Any, panels: Iterable[Axes], columns: int) -> Any:
    """Draw one legend below the panels that has each label once."""
    marks: dict[str, Any] = {}
    for panel in panels:
        for handle, text in zip(*panel.get_legend_handles_labels(), strict=True):
            marks.setdefault(text, handle)
    return picture.legend(
        list(marks.values()), list(marks), loc="outside lower center", ncols=columns,
        columnspacing=1.4, handletextpad=0.5,
    )  # fmt: skip


def colour_bar(picture: Any, image: Any, panels: Any, label: str, **options: Any) -> Any:
    """Draw the scale of an image's colours next to its panels."""
    bar = picture.colorbar(image, ax=panels, label=label, **{"pad": 0.02, **options})
    bar.outline.set_visible(False)
    return bar


def name_lanes(panel: Axes, places: Iterable[float], names: Sequence[str], count: int) -> None:
    """Turn a panel into `count` horizontal lanes, the first at the top, with names at places."""
    panel.set_yticks(list(places), names)
    panel.set_ylim(count - 0.5, -0.5)
    panel.grid(visible=False, axis="y")
    panel.grid(visible=True, axis="x")
    panel.tick_params(axis="y", length=0)


def plain_log(axis: Any) -> None:
    """Label a logarithmic axis with plain numbers: even steps, 1, 2 and 5, or powers of ten."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    low, high = sorted(axis.get_view_interval())
    logarithmic = LogLocator(subs=(1, 2, 5) if high < 100 * low else (1,))
    axis.set_major_locator(logarithmic if high > 10 * low else MaxNLocator(5, steps=(1, 2, 5, 10)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
