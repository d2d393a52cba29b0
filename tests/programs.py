"""Programs and commands as a user starts them, what they print, and how they refuse what makes no sense."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from rock2d.cli import cli
from rock2d.errors import InputError

ROOT = Path(__file__).parents[1]


def same_imports(**environment: str) -> dict[str, str]:
    """The environment of a process of its own, which imports what this one does."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, sys.path)]), **environment}


def printed(code: str, **environment: str) -> str:
    """What Python code prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT,
        env=same_imports(**environment),
    )  # fmt: skip
    return done.stdout.strip()


def other_hash_seed() -> str:
    """A value of PYTHONHASHSEED that is not the one of this process."""
    return "1" if os.environ.get("PYTHONHASHSEED") == "2718" else "2718"


def rock2d(*words: object, timeout_s: float = 120.0, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command line in a process of its own, whatever its exit code."""
    return subprocess.run(
        [sys.executable, "-m", "rock2d.cli", *map(str, words)], capture_output=True, text=True, check=False,
        env={**os.environ, **environment}, timeout=timeout_s,
    )  # fmt: skip


def commanded(*words: object) -> Result:
    """The command line in this process: `exit_code`, `output`, `exception`."""
    return CliRunner().invoke(cli, [str(word) for word in words])


def cluster(workers: int) -> Any:
    """A Dask scheduler and its workers in this process; what they do is seen, and patches hold."""
    from distributed import LocalCluster

    return LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    )


def refusal(function: Callable[..., Any], *given: Any, said: str = "", **options: Any) -> InputError:
    """The error with which a function refuses what it is given; its text matches `said`."""
    with pytest.raises(InputError, match=said or None) as caught:
        function(*given, **options)
    return caught.value


def place_of(words: str, text: str) -> str:
    """Line and column at which words first stand in a text, as errors give them."""
    before = text[: text.index(words)]
    return f"{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"
