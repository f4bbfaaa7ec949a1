"""Every command of the program ends with 0, in chains that a user could type."""

from __future__ import annotations

from contextlib import contextmanager

import pytest
from chains import CHAINS, command_names, lines, run_chain
from commands import command
from programs import Program

#: Chains that only the installed program runs; other tests run their commands, in less time.
LONG = ("bench", "optimize", "render")


def test_every_command_has_a_line():
    run_here = {line.partition(" -")[0] for chain in CHAINS for line in lines(chain)}
    missing = [n for n in command_names() if not any(f"{r} ".startswith(f"{n} ") for r in run_here)]
    assert missing == []


@pytest.mark.parametrize("chain", [chain for chain in CHAINS if chain not in LONG])
def test_the_commands_of_a_chain_end_with_0(chain, tmp_path):
    def run(words):
        done = command(*words, cwd=tmp_path)
        assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
        assert "Warning" not in done.stderr, words

    @contextmanager
    def keep_running(words):
        with Program(*words, cwd=tmp_path) as program:
            program.await_output("running")
            yield
            assert program.end() == 0, program.stderr

    run_chain(chain, tmp_path, run, keep_running)
