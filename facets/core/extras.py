"""Optional packages of some commands, which extras of `facets-6dof` install."""

from __future__ import annotations

from importlib import import_module
from typing import Any
from warnings import catch_warnings

from .errors import InputError

#: The extra that installs a package, by package.
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
        Option, file or address that needs the module, for the message.

    Raises
    ------
    InputError
        If the module cannot be imported; the message names the extra to install.
    """
    package = module.partition(".")[0]
    try:
        with catch_warnings():  # Some packages change the filters of warnings.
            return import_module(module)
    except (ImportError, RuntimeError) as error:  # RuntimeError: a shared library is not found
        raise InputError(
            f'{purpose} needs {package}: pip install "facets-6dof[{EXTRAS[package]}]" ({error})'
        ) from None
