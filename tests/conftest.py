"""Lets the tests import their helpers by name: `commands`, `gltf_page`, `oracle`, `sensors`.

Hypothesis draws the same examples each time, so that a run says something about the change it
tests. `HYPOTHESIS_PROFILE=search pytest ...` draws others, and far more of them.
"""

import os
import signal
import sys
from contextvars import copy_context
from pathlib import Path

import facets.experiments
import pytest
from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None, max_examples=300)
settings.register_profile("search", deadline=None, max_examples=20_000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

# what is started in the background ignores SIGINT, and so would the programs that tests start
signal.signal(signal.SIGINT, signal.default_int_handler)

sys.path.insert(0, str(Path(__file__).parent / "helpers"))
# an installed package has no studies, and takes those beside its tests
facets.experiments.__path__.append(str(Path(__file__).parents[1] / "experiments"))

#: Files that take long, the longest first. They are begun with, so that at the end no process works
#: on one of them while the others have nothing left to do.
LONG = (
    "cli/test_every_command.py",
    "docs/test_guides.py",
    "live/test_live.py",
    "calibration/test_faults.py",
    "design/test_exploration.py",
    "live/test_stopped_stage.py",
    "model/test_executions.py",
    "design/test_page.py",
    "tracking/test_stage_machine.py",
    "design/test_tolerancing.py",
    "calibration/test_bench_rigs.py",
    "cli/test_signals.py",
    "live/test_web_page.py",
    "pictures/test_page_hands.py",
    "estimation/test_estimators.py",
    "tracking/test_pulled_cable.py",
    "proof/test_check_certificate.py",
    "experiments/test_reproduce.py",
    "bench/test_bench.py",
)


def pytest_xdist_auto_num_workers() -> int:
    """Three processes for two cores, since a test waits for ports and programs, too; each more
    would import everything once again, and disturb what records in real time."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return 3 * (cores or 1) // 2


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """In one process quick tests go first, so that a failure is known soon."""
    if getattr(config.option, "numprocesses", None) or hasattr(config, "workerinput"):
        root = Path(__file__).parent
        order = {root / name: place for place, name in enumerate(LONG)}
        items.sort(key=lambda item: order.get(item.path, len(LONG)))
    else:
        items.sort(key=lambda item: item.get_closest_marker("slow") is not None)


@pytest.fixture
def run_in_process(tmp_path, monkeypatch, capsys):  # type: ignore[no-untyped-def]
    """Runs a command in this process, in a folder of its own: status, output, errors."""
    from facets.cli import main

    monkeypatch.chdir(tmp_path)

    def one(*words):
        monkeypatch.setattr(sys, "argv", ["facets", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            copy_context().run(main)  # a style that it chooses is its own
        out, err = capsys.readouterr()
        return end.value.code, out, err

    return one
