"""Errors that `facets` raises for bad input; a pose that cannot be solved has a status instead."""


class FacetsError(Exception):
    """Base of all errors that the package raises; its text is a complete message for the user."""


class ConfigError(FacetsError):
    """A configuration that cannot be used; the message has file, line, key and allowed values."""


class InputError(FacetsError):
    """Data or arguments that cannot be used: wrong shape, missing column, unreadable file."""


class OutputError(FacetsError):
    """A result that cannot be written, or that would overwrite an older one."""
