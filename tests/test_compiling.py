"""Who waits for the compiler is told so: once, by the command line, and only if there is something to compile."""

import gc
import subprocess
import sys

import pytest

from rock2d.cli import COMPILING
from tests.programs import same_imports

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
    environment = same_imports(XDG_CACHE_HOME=str(tmp_path / "cache"))
    environment.pop("NUMBA_CACHE_DIR", None)

    def run(*words: str) -> str:
        options = {"cwd": tmp_path, "env": environment, "capture_output": True, "text": True, "check": True}
        return subprocess.run([sys.executable, *words], **options).stderr

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


TOGETHER = """
import sys, time
from pathlib import Path

import numpy as np
from numba.core import event
from rock2d.compiled import copy

class Counted(event.Listener):
    compiled = 0

    def on_start(self, event):
        self.compiled += 1

    def on_end(self, event):
        time.sleep(1.0)  # long enough for the other process to ask for the same function

heard = Counted()
event.register("numba:compile", heard)
Path(sys.argv[1]).touch()
while not Path(sys.argv[2]).exists():  # both begin at once
    time.sleep(0.01)
target = np.zeros(3)
copy(np.ones(3), target)
assert target.all()
print(heard.compiled)
"""


def test_two_processes_at_once_compile_a_function_once(tmp_path):
    environment = same_imports(NUMBA_CACHE_DIR=str(tmp_path))
    ready = [str(tmp_path / name) for name in ("one", "other")]
    processes = [
        subprocess.Popen([sys.executable, "-c", TOGETHER, *order], env=environment, stdout=subprocess.PIPE, text=True)
        for order in (ready, ready[::-1])
    ]
    counts = [int(process.communicate(timeout=120)[0]) for process in processes]
    assert sorted(counts) == [0, 1]


def test_a_function_that_fails_to_compile_leaves_no_lock(tmp_path, monkeypatch):
    from rock2d.compiled import _alone, njit, numba

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def wrong(x):
        return x + "m"

    made = njit(wrong)
    for _ in range(2):
        with pytest.raises(numba.TypingError):
            made(1.0)
    (lock,) = tmp_path.glob("*.lock")
    with _alone(lock.stem):  # at once
        assert not gc.isenabled()
    assert gc.isenabled()


def test_a_part_gives_the_same_bits_inside_another_function_and_for_python():
    """Parts are optimized with their callers; no optimization may reorder arithmetic."""
    import numpy as np

    from rock2d.engines.contact_state import new_contacts
    from rock2d.laws.contact import normal_force, tangential_force

    numbers = np.random.default_rng(1).uniform(0.1, 2.0, (200, 4)).tolist()
    for depth, peak, k_l, k_ul in numbers:
        for law in (normal_force, tangential_force):
            assert law(depth, peak, k_l, k_ul) == law.py_func(depth, peak, k_l, k_ul)
    assert (new_contacts(3).reals == new_contacts.py_func(3).reals).all()
