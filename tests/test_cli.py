"""How a command ends that is asked to end: one plain line and its own exit code."""

from __future__ import annotations

import signal
import subprocess
import sys
from functools import partial

import pytest

COMMAND = """
import atexit, os, signal, sys, time
from rock2d import cli

@cli.cli.command()
def wait():
    print(flush=True)
    time.sleep(60)

@cli.cli.command()
def end():
    atexit.register(os.kill, os.getpid(), signal.SIGINT)
    atexit.register(os.kill, os.getpid(), signal.SIGTERM)

cli.main()
"""


def started(command: str, ctrl_c: signal.Handlers) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", COMMAND, command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, ctrl_c),
    )  # fmt: skip


@pytest.mark.parametrize("ctrl_c", [signal.SIG_DFL, signal.SIG_IGN])  # ignored: a shell's background job
def test_a_request_to_end_is_answered_with_one_line(ctrl_c):
    with started("wait", ctrl_c) as process:
        assert process.stdout is not None and process.stdout.readline()
        process.terminate()
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors.strip()) == (143, "terminated: no half-written file is left")


def test_a_signal_while_python_ends_does_not_change_the_exit_code():
    with started("end", signal.SIG_DFL) as process:
        _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (0, "")
