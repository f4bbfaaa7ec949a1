"""Lets the tests import their helpers by name: `oracle`, `sensors`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
