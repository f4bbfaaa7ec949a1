"""Commands as a person runs them: a process of its own, in a folder of its own."""

import subprocess
import sys
from pathlib import Path

PROGRAM = [sys.executable, "-c", "from facets.cli import main; main()"]


def command(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """`facets WORDS`, run in `cwd`, with what it printed and its exit status."""
    return subprocess.run(
        [*PROGRAM, *words], cwd=cwd, capture_output=True, text=True, timeout=600, check=False
    )
