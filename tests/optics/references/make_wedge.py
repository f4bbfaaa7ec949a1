"""Moments of a normal distribution over wedges to 30 digits, stored in wedge.json.

    python tests/optics/references/make_wedge.py

For each point in the file, by the rigorous integration of `experiments/studies/wedge_errors.py`.
The points are a grid over the domain, and those at which the float code did worst in a search. What
is stored came from a quadrature in mpmath at 50 digits, which shared no code with this one; both
agree to 3e-25.
"""

from __future__ import annotations

import json
from pathlib import Path

from facets.experiments.studies.wedge_errors import exact_wedge

NAMES = ("q", "u1", "u2")


def main() -> None:
    file = Path(__file__).with_name("wedge.json")
    rows = json.loads(file.read_text())
    for row in rows:
        point = (tuple(float.fromhex(x) for x in row[name]) for name in NAMES)
        exact = exact_wedge(*point, tolerance=1e-34)
        parts = (exact[kind] for kind in ("mass", "centroid", "covariance"))
        row["exact"] = [value.str(30, radius=False) for part in parts for value in part]
    file.write_text(json.dumps(rows, indent=0) + "\n")


if __name__ == "__main__":
    main()
