"""Simulated reader who types a documentation page's commands in a folder."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

from commands import command
from pages import agree, shape


class Reader:
    """Type a page's commands and run its Python.

    outputs: what each command has printed; a command is not run again.
    """

    def __init__(self, folder):
        self.folder = folder
        self.outputs = {}
        self.printed = []
        self.has_measured = False
        here = str(Path(sys.executable).parent)
        self.environment = {**os.environ, "PATH": f"{here}{os.pathsep}{os.environ['PATH']}"}

    def follow(self, step):
        if step.language == "yaml":
            (self.folder / step.file).write_text(step.block)
        elif step.language == "bash":
            for line in step.block.splitlines():
                self.type(line)
        elif step.language == "python":
            subprocess.run([sys.executable, "-c", step.block], cwd=self.folder, check=True)
        elif step.language in ("", "text") and self.printed:
            self.compare(step.block.splitlines(), "from run to run" in step.text)

    def type(self, line):
        """Run a line; a comment states its exit status if that is not 0."""
        self.has_measured |= "virtual:" in line
        if line not in self.outputs:
            self.outputs[line] = self.run(line)
        self.printed += self.outputs[line]

    def run(self, line):
        words = shlex.split(line, comments=True)
        if words[0] == "facets" and ">" not in words:
            done = command(*words[1:], cwd=self.folder)
        else:
            done = subprocess.run(
                ["bash", "-c", line], cwd=self.folder, env=self.environment, text=True,
                capture_output=True, timeout=600, check=False,
            )  # fmt: skip
        stated = re.search(r"# ends with status (\d+)", line)
        printed = done.stdout + done.stderr
        assert done.returncode == (int(stated[1]) if stated else 0), f"{line}\n{printed}"
        return printed.splitlines()

    def compare(self, lines, is_rough=False):
        """Check that a page's output was printed; `...` matches anything. Numbers agree to 2 %, to
        a factor of two where the virtual bench gave them, whose noise is new in every run, and to a
        factor of ten where the page says that they differ."""
        for line in lines:
            pattern = re.escape(shape(line)).replace(re.escape("..."), ".*")
            printed = [other for other in self.printed if re.fullmatch(pattern, shape(other))]
            assert printed, line
            share = 9.0 if is_rough else 1.0 if self.has_measured else 0.02
            assert any(agree(line, other, share) for other in printed), f"{line}\n{printed[-1]}"
