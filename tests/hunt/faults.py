"""Every command, disturbed from outside: killed, interrupted, on a full disk, into a folder that is read-only.

`python -m tests.hunt.faults --work FOLDER` prints a table. After each disturbance no process may be left, no file may
stand under its final name unless it is whole, the exit code must be right, the message must be one line without a
traceback, and the same command given again must end with the undisturbed result. It is not given again where it left
its folder as it found it.

A full disk and a read-only folder are small file systems of their own if the user may mount them. Else a limit on the
size of files stands for the full disk, and the read-only folder is skipped for a user whom permissions do not bind."""

import argparse
import json
import os
import random
import resource
import secrets
import shutil
import signal
import subprocess
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import psutil

from tests.hunt.fault_commands import COMMANDS, Command, make_inputs
from tests.test_processes import heed_interrupts

MARK = "ROCK2D_HUNT"  # variable that marks the processes of a command
SIGNALS = {"kill": signal.SIGKILL, "interrupt": signal.SIGINT, "terminate": signal.SIGTERM}
FAULTS = (*SIGNALS, "kill a worker", "full disk", "file too large", "read-only")
SHARES_TRIED = 4  # shares of the duration, each half of the one before, until a signal meets what it is for
EARLIEST_S = 1.0  # a signal before that meets Python while it starts
LONGEST_END_S = 5.0  # from a signal to the end
LONGEST_REFUSAL_S = 8.0  # from the start to the refusal of a read-only folder
ORPHANS_END_S = 3.0
LONGEST_RUN_S = 900.0
EXIT_BAD_INPUT, EXIT_MACHINE = 2, 3
EXITS = {"kill": -signal.SIGKILL, "interrupt": 130, "terminate": 143}
# these may hold durations: must be readable; all others must have the same size
INEXACT = (".html", ".json", ".npz", ".md")


@dataclass
class Whole:
    """What a command leaves undisturbed: seconds, and the size in bytes of each file by its path."""

    seconds: float
    sizes: dict[str, int]


@dataclass
class Trial:
    """A disturbed command: what went wrong, and the seconds from the disturbance to the end."""

    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0
    skipped: str = ""


def visible_sizes(folder: Path) -> dict[str, int]:
    """Size in bytes of each file under a final name."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    parts = {path: path.relative_to(folder) for path in files}
    return {
        str(part): path.stat().st_size
        for path, part in parts.items()
        if not any(name.startswith(".") for name in part.parts)
    }


def leftovers(folder: Path, kept: tuple[str, ...]) -> list[str]:
    """Temporary files and folders, without the folders from which a command continues."""
    names = [path.relative_to(folder) for path in folder.rglob(".*")]
    return [str(name) for name in names if not set(kept) & set(name.parts)]


def touched(folder: Path, prepared: dict[str, int]) -> bool:
    """If a folder holds anything but the files of these sizes."""
    return visible_sizes(folder) != prepared or bool(leftovers(folder, ()))


def cut_files(folder: Path, whole: Whole) -> list[str]:
    """Files under a final name that are not whole."""
    return [
        name
        for name, size in visible_sizes(folder).items()
        if not (_readable(folder / name) if name.endswith(INEXACT) else size == whole.sizes.get(name))
    ]


def _readable(path: Path) -> bool:
    if path.suffix == ".npz":
        return zipfile.is_zipfile(path)
    text = path.read_text(encoding="utf-8")
    with suppress(ValueError):
        return path.suffix != ".json" or json.loads(text) is not None
    return path.suffix != ".json" and (path.suffix != ".html" or text.rstrip().endswith("</html>"))


@dataclass
class Started:
    """A running command, the file of its messages, and the mark in the environment of its processes."""

    process: subprocess.Popen[str]
    messages: IO[str]
    mark: str

    def end(self) -> str:
        """Wait for its end; what it said."""
        self.process.wait(LONGEST_RUN_S)
        self.messages.seek(0)
        return self.messages.read()


@contextmanager
def started(command: Command, inputs: Path, out: Path, before: Callable[[], None] | None = None) -> Iterator[Started]:
    """The command in a process group of its own, with the mark in its environment; its processes end with the block."""
    mark = secrets.token_hex(8)

    def prepare() -> None:
        heed_interrupts()
        if before is not None:
            before()

    with tempfile.TemporaryFile("w+") as errors:  # a pipe would stay open until the last orphan ends
        process = subprocess.Popen(
            command.arguments(inputs, out), stdout=subprocess.DEVNULL, stderr=errors, text=True,
            env={**os.environ, MARK: mark}, process_group=0, preexec_fn=prepare,
        )  # fmt: skip
        try:
            yield Started(process, errors, mark)
        finally:
            for left in marked(mark):
                with suppress(psutil.Error):
                    left.kill()


def marked(mark: str, word: str = "") -> list[psutil.Process]:
    """The living processes of a command with this word in their command line."""
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            alive = process.environ().get(MARK) == mark and process.status() != psutil.STATUS_ZOMBIE
            if alive and word in " ".join(process.cmdline()):
                found.append(process)
    return found


def orphans(mark: str) -> int:
    """How many processes of a command are left a few seconds after its end."""
    end = time.monotonic() + ORPHANS_END_S
    while (left := len(marked(mark))) and time.monotonic() < end:
        time.sleep(0.1)
    return left


def said_badly(errors: str) -> list[str]:
    """What is wrong with the message of a command that failed."""
    lines = [line for line in errors.splitlines() if line.strip() and "warn" not in line.lower()]
    if "Traceback" in errors:
        return [f"traceback: {lines[-1][:100]}"]
    return [] if len(lines) == 1 else [f"{len(lines)} lines: {' / '.join(lines)[:160]}"]


def undisturbed(command: Command, inputs: Path, out: Path) -> Whole:
    """Run a command to its end."""
    command.prepare(inputs, out)
    begin = time.monotonic()
    with started(command, inputs, out) as running:
        errors = running.end()
    assert running.process.returncode == command.whole_exit, f"{command.name}: {errors}"
    return Whole(time.monotonic() - begin, visible_sizes(out))


def signalled(command: Command, fault: str, inputs: Path, out: Path, whole: Whole, share: float) -> Trial:
    """Kill or interrupt a command after a share of its duration, then give it again."""
    trial = Trial()
    command.prepare(inputs, out)
    prepared = visible_sizes(out)
    with started(command, inputs, out) as running:
        time.sleep(max(share * whole.seconds, EARLIEST_S))
        hit = _hit(fault, running)
        begin = time.monotonic()
        errors = running.end()
        trial.seconds = time.monotonic() - begin
        if left := orphans(running.mark):
            trial.faults.append(f"{left} processes left")
    if not hit:
        trial.skipped = "no worker from then on" if fault == "kill a worker" else "ended before"
        return trial
    code = running.process.returncode
    if code not in (command.whole_exit, EXITS.get(fault)):
        trial.faults.append(f"exit code {code}")
    if code != command.whole_exit and fault != "kill":
        trial.faults += said_badly(errors)
        trial.faults += [f"left: {name}" for name in leftovers(out, command.kept)]
    if fault in SIGNALS and trial.seconds > LONGEST_END_S:
        trial.faults.append(f"{trial.seconds:.0f} s to the end")
    trial.faults += [f"cut: {name}" for name in cut_files(out, whole)]
    if code != command.whole_exit and touched(out, prepared):
        trial.faults += again(command, inputs, out, whole)
    return trial


def _hit(fault: str, running: Started) -> bool:
    process = running.process
    if process.poll() is not None:
        return False
    if fault == "interrupt":  # the terminal sends Ctrl-C to all
        os.killpg(process.pid, signal.SIGINT)
    elif fault in SIGNALS:
        process.send_signal(SIGNALS[fault])
    else:
        while not (workers := marked(running.mark, "spawn_main")):
            if process.poll() is not None:
                return False
            time.sleep(0.1)
        random.choice(workers).kill()
    return True


def again(command: Command, inputs: Path, out: Path, whole: Whole) -> list[str]:
    """Give a command a second time in the same place; what is wrong with its result."""
    with started(command, inputs, out) as running:
        errors = running.end()
    if running.process.returncode != command.whole_exit:
        return [f"again: exit code {running.process.returncode}: {errors.strip()[-160:]}"]
    found = [f"again: cut: {name}" for name in cut_files(out, whole)]
    found += [f"again: missing: {name}" for name in whole.sizes if not (out / name).is_file()]
    return found + [f"again: left: {name}" for name in leftovers(out, ())]


def on_full_disk(command: Command, inputs: Path, out: Path, whole: Whole, share: float) -> Trial:
    """Run on a file system with room for a share of the result, then enlarge it and run again."""
    need = _needed(whole.sizes)
    with small_disk(out) as resize:
        if resize is None:
            return Trial(skipped="may not mount")
        command.prepare(inputs, out)
        prepared = visible_sizes(out)
        used = _needed(prepared)
        resize(f"size={used + max(4096, int(share * (need - used)) // 4096 * 4096)}")
        trial = _refused(command, inputs, out, whole, EXIT_MACHINE)
        resize("size=1g")
        if not trial.skipped and touched(out, prepared):
            trial.faults += again(command, inputs, out, whole)
    return trial


def _needed(sizes: dict[str, int]) -> int:
    """Room in bytes that files of these sizes need."""
    return sum(-(-size // 4096) + 1 for size in sizes.values()) * 4096


def with_short_files(command: Command, inputs: Path, out: Path, whole: Whole, share: float) -> Trial:
    """Run with a limit on the size of files: a share of the largest file of the result."""
    command.prepare(inputs, out)
    before = visible_sizes(out)
    limit = int(share * max(size for name, size in whole.sizes.items() if name not in before))

    def lower() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))

    return _refused(command, inputs, out, whole, EXIT_MACHINE, lower)


def into_read_only(command: Command, inputs: Path, out: Path, whole: Whole) -> Trial:
    """Run into a folder that cannot be written; it must be refused before the work."""
    with small_disk(out) as resize:
        if resize is None:
            if os.geteuid() == 0:
                return Trial(skipped="may not mount")
            command.prepare(inputs, out)
            out.chmod(0o500)
        else:
            command.prepare(inputs, out)
            resize("ro")
        trial = _refused(command, inputs, out, whole, EXIT_BAD_INPUT)
        if resize is None:
            out.chmod(0o700)
    if trial.seconds > LONGEST_REFUSAL_S:
        trial.faults.append(f"refused after {trial.seconds:.0f} s")
    return trial


def _refused(
    command: Command, inputs: Path, out: Path, whole: Whole, code: int, before: Callable[[], None] | None = None
) -> Trial:
    trial, begin = Trial(), time.monotonic()
    with started(command, inputs, out, before) as running:
        errors = running.end()
        trial.seconds = time.monotonic() - begin
        if left := orphans(running.mark):
            trial.faults.append(f"{left} processes left")
    returned = running.process.returncode
    trial.faults += [f"cut: {name}" for name in cut_files(out, whole)]
    if returned == command.whole_exit:
        if trial.faults or visible_sizes(out).keys() != whole.sizes.keys():
            trial.faults.append(f"exit code {returned}")
        trial.skipped = "" if trial.faults else "had room"
        return trial
    if returned != code:
        trial.faults.append(f"exit code {returned}")
    trial.faults += said_badly(errors)
    trial.faults += [f"left: {name}" for name in leftovers(out, command.kept)]
    return trial


@contextmanager
def small_disk(folder: Path) -> Iterator[Callable[[str], None] | None]:
    """Mount a file system at `folder`; gives a function that changes its options, None if that may not be."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        yield None
        return
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1g", "tmpfs", str(folder)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        yield None
        return

    def change(options: str) -> None:
        subprocess.run(["mount", "-o", f"remount,{options}", str(folder)], check=True, capture_output=True)

    try:
        yield change
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def disturbed(command: Command, fault: str, inputs: Path, work: Path, whole: Whole, share: float) -> Trial:
    """One disturbance of a command, in a new folder under `work`."""
    out = work / f"out_{secrets.token_hex(4)}"
    out.mkdir(parents=True)
    try:
        if fault == "full disk":
            return on_full_disk(command, inputs, out, whole, share)
        if fault == "file too large":
            return with_short_files(command, inputs, out, whole, share)
        if fault == "read-only":
            return into_read_only(command, inputs, out, whole)
        for _ in range(SHARES_TRIED):
            trial = signalled(command, fault, inputs, out, whole, share)
            if not trial.skipped:
                break
            shutil.rmtree(out)
            out.mkdir()
            share /= 2
        return trial
    finally:
        shutil.rmtree(out, ignore_errors=True)


def main() -> None:
    """Disturb commands and print what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder for inputs and outputs")
    parser.add_argument("--commands", default="", help="only those whose name contains this")
    parser.add_argument("--faults", nargs="*", choices=FAULTS, default=FAULTS)
    parser.add_argument("--times", type=int, default=2, help="disturbances of each kind")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    random.seed(chosen.seed)
    work = chosen.work.absolute()
    make_inputs(work / "inputs")
    print(f"{'command':32s}{'fault':16s}{'share':>6s}{'seconds':>9s}  result")
    wrong = 0
    for command in COMMANDS:
        if chosen.commands not in command.name:
            continue
        undisturbed_out = work / f"whole_{secrets.token_hex(4)}"
        undisturbed_out.mkdir()
        whole = undisturbed(command, work / "inputs", undisturbed_out)
        shutil.rmtree(undisturbed_out)
        for fault in chosen.faults:
            if fault == "kill a worker" and not command.has_workers:
                continue
            for _ in range(1 if fault == "read-only" else chosen.times):
                share = random.random()
                trial = disturbed(command, fault, work / "inputs", work, whole, share)
                wrong += bool(trial.faults)
                result = "; ".join(trial.faults) or trial.skipped or "ok"
                row = f"{command.name:32s}{fault:16s}{share:6.2f}{trial.seconds:9.1f}  {result}"
                print(row, flush=True)
    print(f"{wrong} disturbances went wrong")
    raise SystemExit(wrong > 0)


if __name__ == "__main__":
    main()
