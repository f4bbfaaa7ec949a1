"""What shells offer at the tabulator."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess

import pytest
from commands import PROGRAM, command

#: How each shell is told of the program, and asked what it would offer for the words in $1.
SHELLS = {
    "bash": """
        eval "$(_FACETS_COMPLETE=source_bash facets)"
        read -ra COMP_WORDS <<< "$1"
        [[ $1 == *" " ]] && COMP_WORDS+=("")
        COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
        _facets_completion facets
        printf '%s\\n' "${COMPREPLY[@]}"
        """,
    "fish": """
        env _FACETS_COMPLETE=source_fish facets | source
        complete --do-complete $argv[1]
        """,
    "zsh": """
        autoload -Uz compinit && compinit -u -D
        eval "$(_FACETS_COMPLETE=source_zsh facets)"
        _arguments() { print -r -- "$@" }
        _files() { : }
        words=("${(@s: :)1}") CURRENT=${#words}
        _facets_completion
        """,
}


@pytest.fixture
def offered(tmp_path, monkeypatch):
    """Asks a shell what it offers, in a folder with a configuration `mine.yaml`."""
    program = tmp_path / "bin" / "facets"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {shlex.join(PROGRAM)} "$@"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "mine.yaml").write_text("extends: rig\nmotions: {}\n")

    def ask(shell, typed):
        if shutil.which(shell) is None:
            pytest.skip(f"{shell} is not installed")
        words = [shell, "-c", SHELLS[shell], shell, typed]
        if shell == "fish":
            words = ["fish", "-c", SHELLS[shell], typed]
        result = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert result.stderr == ""
        if shell == "zsh":  # "name":"what it is", for its own menu
            return set(re.findall(r'"([^"]+)"(?::"[^"]*")?', result.stdout))
        return {line.partition("\t")[0] for line in result.stdout.splitlines()}

    return ask


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.slow
def test_shells_offer_commands_configurations_and_what_is_in_them(shell, offered):
    assert {"solve", "simulate"} <= offered(shell, "facets s")
    assert {"paper", "parts"} <= offered(shell, "facets solve pa")
    assert offered(shell, "facets simulate paper --motion mult") == {"multi-axis"}


def complete(typed, folder):
    """What fish would be given; the same function answers the other shells."""
    env = {"_FACETS_COMPLETE": "complete_fish", "_TYPER_COMPLETE_FISH_ACTION": "get-args",
           "_TYPER_COMPLETE_ARGS": f"facets {typed}"}  # fmt: skip
    result = command(cwd=folder, env=env)
    assert result.returncode == 0, result.stderr
    return [line.partition("\t")[0] for line in result.stdout.splitlines() if line]


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("solve m", ["market", "mine.yaml"]),
        ("solve ./m", ["./mine.yaml"]),
        ("solve a", ["a b/"]),
        ("solve ../no", []),
        ("config check skew", ["skewed"]),
        ("noise rec --config skew", ["skewed"]),
        ("render paper --at tz_mm=1,ya", ["tz_mm=1,yaw_mrad="]),
        ("render paper --at tz_mm=1,tz", []),
        ("calibrate paper --effect spl", ["spline=on", "spline=off", "spline=auto"]),
        ("explore layout --objective cond", ["condition"]),
        ("reproduce fig1", ["fig10", "fig11"]),
        ("simulate nowhere --motion ", []),
        ("simulate mine.yaml --motion multi", ["multi-axis"]),
        ("emulate broken.yaml --motion ", []),
    ],
)
def test_names_are_completed(typed, expected, tmp_path):
    (tmp_path / "mine.yaml").write_text("extends: paper\n")
    (tmp_path / "broken.yaml").write_text("sensor: [")
    (tmp_path / "a b").mkdir()
    (tmp_path / "another.csv").touch()
    assert complete(typed, tmp_path) == expected
