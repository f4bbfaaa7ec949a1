"""Packages that some commands need and that are installed by extras of `facets-6dof`."""

from __future__ import annotations

from importlib import import_module
from typing import Any
from warnings import catch_warnings

from .errors import InputError

#: The extra that brings a package.
EXTRAS = {
    "aiohttp": "web",
    "av": "scenes",
    "casadi": "design",
    "distributed": "cluster",
    "flint": "proof",
    "h5py": "hdf5",
    "mcap": "mcap",
    "mpmath": "bench",
    "nidaqmx": "ni",
    "nptdms": "tdms",
    "plotly": "pages",
    "pyarrow": "parquet",
    "pylablib": "thorlabs",
    "pylsl": "lsl",
    "pyuff": "uff",
    "pyvista": "scenes",
    "xarray": "xarray",
}


def require_extra(module: str, purpose: str) -> Any:
    """Import a module of an optional package.

    Parameters
    ----------
    module : str
        Name of the module, such as "mcap.writer".
    purpose : str
        What needs it, for the message: an option, a file or an address.

    Raises
    ------
    InputError
        Where it cannot be imported; the message names the extra to install.
    """
    package = module.partition(".")[0]
    try:
        with catch_warnings():  # some show all programs' warnings once they are imported
            return import_module(module)
    except (ImportError, RuntimeError) as error:  # RuntimeError: its own library is not found
        raise InputError(
            f'{purpose} needs {package}: pip install "facets-6dof[{EXTRAS[package]}]" ({error})'
        ) from None
