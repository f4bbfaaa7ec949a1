"""Sources of samples (ports, files and cards), their frames, and their clocks."""

from ...core.closing import ClosedAtExit as ClosedAtExit
from .contract import check_missing as check_missing, check_source as check_source
from .source import Block as Block, PortError as PortError, PortInUse as PortInUse, Source as Source
