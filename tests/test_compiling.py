"""Who waits for the compiler is told so: once, by the command line, and only if there is something to compile."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from rock2d.cli import COMPILING

PROGRAM = """
import click
import numpy as np

from rock2d import cli
from rock2d.processes import as_finished

def work(size):
    from rock2d.compiled import copy

    target = np.zeros(size)
    copy(np.ones(size), target)
    assert target.all()

@cli.cli.command()
@click.option("--workers", type=int, default=1)
@click.option("--quiet", is_flag=True)
def tiny(workers, quiet):
    list(as_finished(work, [(2,), (3,)], workers))

if __name__ == "__main__":
    cli.main()
"""


@pytest.fixture
def said(tmp_path):
    """What the program writes to stderr, with a cache that is empty at first."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    cache = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONPATH": os.pathsep.join(sys.path)}

    def run(*words: str) -> str:
        environment = {**os.environ, **cache}
        environment.pop("NUMBA_CACHE_DIR", None)
        done = subprocess.run(
            [sys.executable, *words],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stderr

    return run


def test_a_command_says_once_that_it_compiles_and_nothing_if_the_cache_holds_the_code(said):
    assert said("program.py", "tiny").splitlines() == [COMPILING]
    assert said("program.py", "tiny") == ""


@pytest.mark.parametrize(
    "words",
    [
        ("program.py", "tiny", "--quiet"),
        ("program.py", "tiny", "--workers", "2"),
        ("-c", "import program; program.work(2)"),
    ],
    ids=["quiet", "workers", "library"],
)
def test_nothing_is_said_where_nobody_waits_at_a_terminal(said, words):
    assert said(*words) == ""
