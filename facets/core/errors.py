"""The errors that a user of `facets` can meet. Bad input raises one; a bad pose returns a
status."""


class FacetsError(Exception):
    """Base of all errors that the package raises; its text is complete and meant for a person."""


class ConfigError(FacetsError):
    """A configuration that cannot be used; names file, line, key, and what is allowed."""


class InputError(FacetsError):
    """Data or arguments that cannot be used: wrong shape, missing column, unreadable file."""


class OutputError(FacetsError):
    """A result that cannot be written, or that would overwrite an older one."""
