"""Sources of samples (ports, files and cards), their frames, and their clocks."""

from ...core.closing import ClosedAtExit as ClosedAtExit
from .contract import check_missing as check_missing
from .contract import check_source as check_source
from .source import Block as Block
from .source import PortError as PortError
from .source import PortInUse as PortInUse
from .source import Source as Source
