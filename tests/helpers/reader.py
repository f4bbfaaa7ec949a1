"""Simulated reader who types a documentation page's commands in a folder."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from commands import command
from pages import Step, agree, shape


class Reader:
    """Type a page's commands and run its Python; a block for the first terminal runs until the text
    stops it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bench: subprocess.Popen[str] | None = None
        self.printed: list[str] = []
        self.has_measured = False
        here = str(Path(sys.executable).parent)
        self.environment = {**os.environ, "PATH": f"{here}{os.pathsep}{os.environ['PATH']}"}

    def follow(self, step: Step) -> None:
        if "Ctrl-C" in step.text:
            self.stop()
        if step.language == "yaml":
            (self.folder / step.file).write_text(step.block)
        elif step.language == "bash" and "first terminal" in step.text:
            self.start(step.block)
        elif step.language == "bash":
            for line in step.block.splitlines():
                self.type(line)
        elif step.language == "python":
            subprocess.run([sys.executable, "-c", step.block], cwd=self.folder, check=True)
        elif step.language in ("", "text") and self.printed:
            self.compare(step.block.splitlines(), "from run to run" in step.text)

    def start(self, line: str) -> None:
        assert self.bench is None, f"the first terminal is still busy: {line}"
        self.bench = subprocess.Popen(
            ["bash", "-c", line], cwd=self.folder, env=self.environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        self.has_measured = True
        assert self.bench.stdout is not None
        printed = []
        for text in self.bench.stdout:  # up to the ports' names
            printed.append(text)
            if "/board" in text:
                return
        raise AssertionError(f"{line}{''.join(printed)}")

    def stop(self) -> None:
        """Send Ctrl-C to the first terminal."""
        bench, self.bench = self.bench, None
        if bench is None:
            return
        os.killpg(bench.pid, signal.SIGINT)
        printed, _ = bench.communicate(timeout=60)
        assert bench.returncode == 0, printed

    def end(self) -> None:
        """Close the first terminal if it is still busy."""
        if self.bench:
            os.killpg(self.bench.pid, signal.SIGKILL)
            self.bench.communicate()

    def type(self, line: str) -> None:
        """Run a line in the second terminal; a comment states its exit status if that is not 0."""
        words = shlex.split(line, comments=True)
        if words[0] == "facets" and ">" not in words:
            done = command(*words[1:], cwd=self.folder)
        else:
            done = subprocess.run(
                ["bash", "-c", line], cwd=self.folder, env=self.environment, text=True,
                capture_output=True, timeout=600, check=False,
            )  # fmt: skip
        told = re.search(r"# ends with status (\d+)", line)
        printed = done.stdout + done.stderr
        assert done.returncode == (int(told[1]) if told else 0), f"{line}\n{printed}"
        self.printed += printed.splitlines()

    def compare(self, lines: Iterable[str], is_rough: bool = False) -> None:
        """Check that a page's output was printed; `...` matches anything. Numbers agree to 2 %, to
        a factor of two where the virtual bench gave them, whose noise is new in every run, and to a
        factor of ten where the page says that they differ."""
        for line in lines:
            pattern = re.escape(shape(line)).replace(re.escape("..."), ".*")
            printed = [one for one in self.printed if re.fullmatch(pattern, shape(one))]
            assert printed, line
            share = 9.0 if is_rough else 1.0 if self.has_measured else 0.02
            assert any(agree(line, one, share) for one in printed), f"{line}\n{printed[-1]}"
