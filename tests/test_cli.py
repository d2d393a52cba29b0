"""How a command ends that is asked to end: one plain line and its own exit code."""

import os
import signal
import subprocess
import sys
from functools import partial

import pytest

from tests.programs import commanded

COMMAND = """
import atexit, os, pickle, signal, sys, time
from rock2d import cli

@cli.cli.command()
def wait():
    print(flush=True)
    time.sleep(60)

@cli.cli.command()
def wait_in_exec():  # as imports do: a dataclass or a named tuple is made by exec
    exec("print(flush=True); time.sleep(60)")

class Slow:
    def __del__(self):
        print(flush=True)
        time.sleep(60)

@cli.cli.command()
def wait_in_destructor():
    Slow()
    time.sleep(60)

class Constant:
    def __reduce__(self):
        code = "import time; print(flush=True); time.sleep(1); print('machine code has its constant', flush=True)"
        return exec, (code,)

@cli.cli.command()
def wait_in_machine_code():
    from numba.core.serialize import _numba_unpickle
    _numba_unpickle(0, pickle.dumps(Constant()), b"")
    time.sleep(60)

@cli.cli.command()
def bar():
    from rock2d.progress import Bars
    with Bars(True).stage("waiting", 20, "units") as bar:
        for _ in bar.counted(range(20)):
            time.sleep(0.11)

@cli.cli.command()
def end():
    atexit.register(os.kill, os.getpid(), signal.SIGINT)
    atexit.register(os.kill, os.getpid(), signal.SIGTERM)

@cli.cli.command()
def threads():
    import numpy, scipy.linalg
    from threadpoolctl import threadpool_info
    print(*[own["num_threads"] for own in threadpool_info() if own["user_api"] == "blas"])

cli.main()
"""


def started(command: str, ctrl_c: signal.Handlers, how: tuple[str, str] = ("-c", COMMAND)) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, *how, command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, ctrl_c),
    )  # fmt: skip


@pytest.mark.parametrize("ctrl_c", [signal.SIG_DFL, signal.SIG_IGN])  # ignored: a shell's background job
@pytest.mark.parametrize("command", ["wait", "wait-in-destructor"])  # Python drops an exception in a destructor
def test_a_request_to_end_is_answered_with_one_line(command, ctrl_c):
    with started(command, ctrl_c) as process:
        assert process.stdout is not None and process.stdout.readline()
        process.terminate()
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors.strip()) == (143, "terminated: no half-written file is left")


@pytest.mark.parametrize(
    ("signal_number", "exit_code", "said"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_an_interrupt_in_generated_code_has_its_exit_code(signal_number, exit_code, said, tmp_path, monkeypatch):
    (tmp_path / "commands.py").write_text(COMMAND)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))
    with started("wait-in-exec", signal.SIG_DFL, ("-m", "commands")) as process:
        assert process.stdout is not None and process.stdout.readline()
        process.send_signal(signal_number)
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors.strip()) == (exit_code, f"{said}: no half-written file is left")


@pytest.mark.parametrize(
    ("signal_number", "exit_code", "said"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_an_interrupt_waits_until_machine_code_has_its_constant(signal_number, exit_code, said):
    """Machine code calls Python for its constants, and does not expect an exception there."""
    with started("wait-in-machine-code", signal.SIG_DFL) as process:
        assert process.stdout is not None and process.stdout.readline()
        process.send_signal(signal_number)
        shown, errors = process.communicate(timeout=30)
    assert shown == "machine code has its constant\n"
    assert (process.returncode, errors.strip()) == (exit_code, f"{said}: no half-written file is left")


def test_a_progress_bar_does_not_flood_a_log_file():
    with started("bar", signal.SIG_DFL) as process:
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 0 and 1 <= errors.count("units") <= 3


def test_linear_algebra_has_one_thread(monkeypatch):
    """Small matrices take a multiple of the processor time with two."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    with started("threads", signal.SIG_DFL) as process:
        found, errors = process.communicate(timeout=60)
    assert found.split() and set(found.split()) == {"1"}, errors


def test_a_signal_while_python_ends_does_not_change_the_exit_code():
    with started("end", signal.SIG_DFL) as process:
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (0, "")


@pytest.mark.parametrize(
    "words",
    [
        ("run", "site.yaml", "--precision", "0,5"),
        ("design", "site.yaml", "--range", "2", "0,5"),
        ("design", "site.yaml", "--range", "2", "8", "--over", "ditch.depth_m", "0,5", "2"),
        ("track", "film.avi", "--metres-per-pixel", "0,5", "--fps", "100"),
    ],
)
def test_a_decimal_comma_in_an_option_is_told(words):
    done = commanded(*words)
    assert done.exit_code == 2 and "'0,5' has a decimal comma, write 0.5" in done.output


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "1e999"])
def test_a_number_that_is_not_finite_is_refused(word):
    for option in ("--tolerance", "--above-m"):
        done = commanded("design", "site.yaml", "--range", "2", "8", option, word)
        assert done.exit_code == 2 and f"{option}: '{word}' is not a finite number" in done.output
