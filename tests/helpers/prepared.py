"""Imports what most commands need, and loads the kernels that they call, in `nursery`'s server."""

import atexit
import gc
import importlib
import os
import pkgutil

import facets.cli

import facets

#: Slow modules that commands import inside functions.
HEAVY = (
    "scipy.optimize", "scipy.stats", "scipy.special", "pandas", "pyarrow.parquet", "pyarrow.csv",
    "matplotlib.pyplot", "pydantic", "ruamel.yaml", "rich.table", "pytest",
)  # fmt: skip
#: Parts of the package that are loaded only if a command needs them.
LATE = (
    "facets.bench", "facets.cli", "facets.experiments", "facets.scalars",
    "facets.pictures.stills.render",
)  # fmt: skip

# as `facets.cli.program` does it: registered first, called last, in each command's process
atexit.register(facets.cli.leave)
os.environ.setdefault("MPLBACKEND", "agg")
parts = [part.name for part in pkgutil.walk_packages(facets.__path__, "facets.")]
commands = [f"facets.cli.{module}" for module in facets.cli.COMMANDS.values()]
for name in (*HEAVY, *commands, *(part for part in parts if not part.startswith(LATE))):
    importlib.import_module(name)
sensor = facets.load("bench").sensor
facets.solve(sensor, facets.readings(sensor, [0.0] * 8))
gc.collect()
gc.freeze()
