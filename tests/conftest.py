"""Lets the tests import their helpers by name: `commands`, `gltf_page`, `oracle`, `sensors`.

Hypothesis draws the same examples each time, so that a run says something about the change it
tests. `HYPOTHESIS_PROFILE=search pytest ...` draws others, and far more of them.
"""

import os
import signal
import sys
from pathlib import Path

from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None, max_examples=300)
settings.register_profile("search", deadline=None, max_examples=20_000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

# what is started in the background ignores SIGINT, and so would the programs that tests start
signal.signal(signal.SIGINT, signal.default_int_handler)

sys.path.insert(0, str(Path(__file__).parent / "helpers"))
