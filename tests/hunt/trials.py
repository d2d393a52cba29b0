"""What becomes of damaged files: accepted, refused, or a failure. Every kind of file is read as its command does."""

import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from rock2d.errors import InputError, OldKeyWarning
from tests.hunt import valid_files
from tests.hunt.valid_files import Files

ACCEPTED, REFUSED, FAILED, HANG = "accepted", "refused", "traceback", "hang"
LONGEST_MESSAGE = 1000
RUN_SECONDS = 0.5  # simulated time
COMMAND_SECONDS = 120.0


class Outcome(NamedTuple):
    """ACCEPTED, REFUSED, FAILED or HANG, and the message or the traceback."""

    what: str
    text: str = ""


class Kind(NamedTuple):
    """A kind of file: the valid sets; how its command reads a folder; the same and what is quick of the rest; and the
    arguments of the command, for a folder of damaged files and a new output."""

    sources: Callable[[], Sequence[Files]]
    read: Callable[[Path], None]
    use: Callable[[Path], None]
    command: Callable[[Path, Path], list[str]]


def _read_scenario(folder: Path) -> None:
    from rock2d.files.scenario_reading import load_scenario

    load_scenario(folder / "scenario.yaml", folder)


def _run_scenario(folder: Path) -> None:
    from rock2d.files.scenario_reading import load_scenario
    from rock2d.runs.run import run

    scenario = load_scenario(folder / "scenario.yaml", folder)
    scenario.time_limit_s = min(scenario.longest_release_s(), RUN_SECONDS)
    scenario.outputs.fps = min(scenario.outputs.fps, 1e3)
    run(scenario, releases=1, workers=1).write(folder / "out")


def _read_experiment(folder: Path) -> None:
    from rock2d.diagnosis.diagnose import check_and_segment
    from rock2d.files.experiment import load_experiment
    from rock2d.kinematics.setup_world import setup_world

    experiment = load_experiment(folder)
    sanity, _ = check_and_segment(experiment, setup_world(experiment))
    if sanity.faults:
        raise InputError("; ".join(fault.message for fault in sanity.faults), folder, code="not_diagnosed")


def _read_diagnosis(folder: Path) -> None:
    from rock2d.diagnosis.predict import read_for_prediction

    read_for_prediction(folder / "diagnosis.json")


def _use_diagnosis(folder: Path) -> None:
    from rock2d.diagnosis.predict import predict, read_for_prediction

    predict(_film(), read_for_prediction(folder / "diagnosis.json"))


@cache
def _film():
    return valid_files.small_film()


def _film_folder(folder: Path) -> Path:
    from rock2d.files.experiment import write_experiment

    write_experiment(folder / "film", _film())
    return folder / "film"


KINDS = {
    "scenario": Kind(
        valid_files.scenarios, _read_scenario, _run_scenario,
        lambda folder, out: ["run", str(folder / "scenario.yaml"), "--data", str(folder), "--releases", "1",
                             "--workers", "1", "--quiet", "--out", str(out)],
    ),
    "experiment": Kind(
        valid_files.experiments, _read_experiment, _read_experiment,
        lambda folder, out: ["diagnose", str(folder), "--workers", "1", "--quiet", "--out", str(out)],
    ),
    "diagnosis": Kind(
        valid_files.diagnoses, _read_diagnosis, _use_diagnosis,
        lambda folder, out: ["predict", str(_film_folder(folder)), "--diagnosis", str(folder / "diagnosis.json"),
                             "--out", str(out)],
    ),
}  # fmt: skip


def tried(kind: str, files: Files, use: bool) -> Outcome:
    """Read files in this process; with `use` also what follows."""
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore", OldKeyWarning)
        warnings.simplefilter("ignore", UserWarning)
        folder = _written(Path(name), files)
        try:
            (KINDS[kind].use if use else KINDS[kind].read)(folder)
        except InputError as error:
            message = str(error)
            if not message.isprintable() or len(message) > LONGEST_MESSAGE:
                return Outcome(FAILED, f"a message that is no short line: {message[:2000]!r}")
            if not use and str(folder) not in message:
                return Outcome(FAILED, f"a message that names no file: {message}")
            return Outcome(REFUSED, message)
        except Exception:
            return Outcome(FAILED, traceback.format_exc())
    return Outcome(ACCEPTED)


def commanded(kind: str, files: Files) -> Outcome:
    """Run the command on files. FAILED if it ends otherwise than with 0 (4: releases were cut short), or with 2, one
    line and nothing written."""
    with tempfile.TemporaryDirectory() as name:
        folder, out = _written(Path(name) / "in", files), Path(name) / "out"
        line = [sys.executable, "-m", "rock2d.cli", *KINDS[kind].command(folder, out)]
        try:
            done = subprocess.run(line, capture_output=True, text=True, timeout=COMMAND_SECONDS, check=False)
        except subprocess.TimeoutExpired:
            return Outcome(HANG, f"the command took longer than {COMMAND_SECONDS:g} s")
        if done.returncode in (0, 4) and out.exists():
            return Outcome(ACCEPTED)
        errors = [text for text in done.stderr.splitlines() if not text.startswith("warning: ")]
        whole = not out.exists() or (out / "diagnosis.json").is_file()
        if done.returncode == 2 and len(errors) == 1 and errors[0].startswith("error: ") and whole:
            return Outcome(REFUSED, errors[0])
        return Outcome(FAILED, f"exit code {done.returncode}\n{done.stderr}")


def _written(folder: Path, files: Files) -> Path:
    folder.mkdir(exist_ok=True)
    for name, raw in files.items():
        (folder / name).write_bytes(raw)
    return folder
