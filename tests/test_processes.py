"""Jobs in other processes: the same results, whoever dies, and nobody is left."""

import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import psutil
import pytest

from rock2d.processes import as_finished
from rock2d.progress import Bars
from tests.programs import same_imports

JOBS = [(k,) for k in range(4)]
LARGE = 1_000_000  # numbers; more than a pipe takes


def test_jobs_give_the_same_in_other_processes():
    expected = list(enumerate(np.sqrt(range(4))))
    assert sorted(as_finished(np.sqrt, JOBS, 2)) == sorted(as_finished(np.sqrt, JOBS, 1)) == expected


def die_once(folder: Path, k: int) -> np.ndarray:
    if k == 2 and not (folder / "died").exists():
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return np.full(LARGE, k)


def test_the_jobs_of_a_killed_worker_are_repeated(tmp_path):
    found = dict(as_finished(die_once, JOBS, 2, (tmp_path,)))
    assert (tmp_path / "died").exists()
    assert [found[k][0] for k in range(4)] == [0, 1, 2, 3]


def die(k: int) -> None:
    os._exit(1)


def test_workers_that_keep_dying_are_an_error_of_the_machine():
    with pytest.raises(ChildProcessError, match="worker"):
        list(as_finished(die, JOBS, 2))


def sleep_or_return(k: int) -> np.ndarray:
    if k:
        time.sleep(600)
    return np.full(LARGE, k)


def test_closing_ends_the_workers_at_once():
    with closing(as_finished(sleep_or_return, JOBS, 2)) as results:
        next(results)
        workers = [p for p in psutil.Process().children(recursive=True) if "spawn_main" in " ".join(p.cmdline())]
        begin = time.monotonic()
    assert len(workers) == 2 and not psutil.wait_procs(workers, timeout=0)[1]
    assert time.monotonic() - begin < 2


PARENT = """
import sys
from contextlib import closing
from tests.test_processes import JOBS, announce_and_sleep
from rock2d.processes import as_finished
if __name__ == "__main__":
    list(as_finished(announce_and_sleep, JOBS, 2))
"""


def announce_and_sleep(k: int) -> None:
    with Bars(False).stage("sleeping", 1, "times"):
        os.write(1, f"{os.getpid()}\n".encode())  # whole lines, although two workers write
        time.sleep(600)


def heed_interrupts() -> None:
    """A shell lets what it starts in the background ignore Ctrl-C, and children inherit that."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_workers_do_not_outlive_their_parent(how, tmp_path):
    (tmp_path / "parent.py").write_text(PARENT)
    parent = subprocess.Popen(
        [sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env=same_imports(), preexec_fn=heed_interrupts,
    )  # fmt: skip
    assert parent.stdout is not None
    workers = [psutil.Process(int(parent.stdout.readline())) for _ in range(2)]
    (parent.send_signal if how == signal.SIGKILL else lambda s: os.killpg(parent.pid, s))(how)
    _, left = psutil.wait_procs(workers, timeout=30)
    _, said = parent.communicate(timeout=30)
    for worker in left:
        worker.kill()
    assert not left
    assert how == signal.SIGKILL or "leaked" not in said  # semaphores of the workers


UNGUARDED = """
from pathlib import Path
from rock2d.processes import as_finished, check_not_imported
check_not_imported()
with Path(__file__).with_name("begun").open("a") as file:
    file.write("once ")
list(as_finished(print, [(1,), (2,)], 2, (bytes(1_000_000),)))  # more than a pipe takes
"""


def test_a_script_without_guard_ends_with_a_message_and_works_once(tmp_path):
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, tmp_path / "script.py"], capture_output=True, text=True, timeout=60,
        env=same_imports(),
    )  # fmt: skip
    assert done.returncode == 1 and (tmp_path / "begun").read_text() == "once "
    assert 'a script without `if __name__ == "__main__":`' in done.stderr.strip().splitlines()[-1]
