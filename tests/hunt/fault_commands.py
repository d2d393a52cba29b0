"""The commands that the fault hunt disturbs, and the small inputs that they need."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.scenarios_of_tests import SHIPPED, small_site

FEW_RELEASES = 12  # releases of each film that is diagnosed, so that this takes less than a minute


def _nothing(inputs: Path, out: Path) -> None:
    pass


def _copied_trial(inputs: Path, out: Path) -> None:
    shutil.copytree(inputs / "trial", out / "trial")


def _copied_results(inputs: Path, out: Path) -> None:
    shutil.copytree(inputs / "diagnosed_trial", out / "trial")


@dataclass(frozen=True)
class Command:
    """A command line. `{here}` in it is the folder of the inputs, `{out}` the folder it writes into.

    Attributes
    ----------
    prepare : puts into the output folder what the command expects there
    kept : names of hidden folders that an interrupted command leaves to continue from
    whole_exit : exit code of the undisturbed command"""

    name: str
    words: str
    prepare: Callable[[Path, Path], None] = _nothing
    kept: tuple[str, ...] = ()
    whole_exit: int = 0

    @property
    def has_workers(self) -> bool:
        """Whether it works in several processes, which a demo does unasked."""
        return "--workers 2" in self.words or self.words.startswith("demo")

    def arguments(self, inputs: Path, out: Path) -> list[str]:
        """What to run, by the interpreter of this process."""
        words = [word.format(here=inputs, out=out) for word in self.words.split()]
        return [sys.executable, "-m", "rock2d.cli", *words]


CUT_SHORT = 4  # releases that ran out of time
_RUN = "run {here}/setup.yaml --quiet --overwrite --out {out}/runs --engine"
_CAMPAIGN = "run {here}/short.yaml --quiet --releases 20001 --out {out}/runs --engine"
COMMANDS = (
    Command("run pymunk, 2 workers", f"{_RUN} pymunk --releases 3 --workers 2"),
    Command("run pymunk, 1 worker", f"{_RUN} pymunk --releases 3 --workers 1"),
    Command("run batch, video", f"{_RUN} batch --releases 1 --video"),
    Command("run point_mass", f"{_RUN} point_mass --releases 20"),
    Command("campaign batch", f"{_CAMPAIGN} batch", whole_exit=CUT_SHORT),
    Command("campaign batch, 2 workers", f"{_CAMPAIGN} batch --workers 2", whole_exit=CUT_SHORT),
    Command("campaign point_mass, 2 workers", f"{_CAMPAIGN} point_mass --workers 2", whole_exit=CUT_SHORT),
    Command("profile", "profile {here}/profile.csv --overwrite --out {out}/site.yaml"),
    Command("design", "design {here}/design.yaml --range 1 6 --tolerance 2 --quiet --overwrite --out {out}/design",
            kept=(".design.judged",)),
    Command("run report", "run {here}/design.yaml --report --quiet --overwrite --out {out}/runs"),
    Command("campaign report", "run {here}/known.yaml --engine point_mass --releases 10500 --report --quiet "
            "--out {out}/runs"),
    Command("design over", "design {here}/design.yaml --range 1 6 --tolerance 5 --over embankment.crest_m 1 2 --quiet "
            "--overwrite --out {out}/over", kept=("over",)),
    Command("demo", "demo --quiet --out {out}/demo"),
    Command("reproduce", "reproduce --quiet --hypotheses 16 --releases 8 --out {out}/paper",
            kept=(".paper.stages",)),
    Command("diagnose, 2 workers", "diagnose {here}/trial/cases/000/fit --quiet --workers 2 --out {out}/diagnosis",
            kept=(".fits",)),
    Command("diagnose, 1 worker", "diagnose {here}/trial/cases/000/fit --quiet --workers 1 --out {out}/diagnosis",
            kept=(".fits",)),
    Command("predict", "predict {here}/trial/cases/000/heldout --diagnosis {here}/diagnosis/diagnosis.json "
            "--out {out}/predictions.csv"),
    Command("compare", "compare {here}/diagnosis {here}/diagnosis/diagnosis.json --out {out}/comparison"),
    Command("blind make", "blind make --quiet --cases 2 --seed 1 --workers 2 --out {out}/trial"),
    Command("blind run", "blind run {out}/trial --quiet --workers 2", _copied_trial),
    Command("blind score", "blind score {out}/trial", _copied_results),
    Command("film", "film {here}/run --quiet --releases 2 --size 640 400 --out {out}/film.avi"),
    Command("track", "track {here}/film.avi --config {here}/film.yaml --quiet --out {out}/tracked"),
    Command("import", "import {here}/tracks_0.txt --kind tracker --config {here}/metres.yaml --y up "
            "--block sphere --out {out}/imported"),
    Command("export", "export {here}/run --out {out}/tracks.txt"),
)  # fmt: skip


def write_scenarios(here: Path) -> None:
    """Write the scenarios that the runs need into the folder `here`."""
    here.mkdir(parents=True, exist_ok=True)
    text = (SHIPPED / "paper_setup.yaml").read_text(encoding="utf-8")
    (here / "setup.yaml").write_text(text, encoding="utf-8")
    short = text.replace("time_limit_s: 3\n", "time_limit_s: 0.1\n")
    (here / "short.yaml").write_text(short, encoding="utf-8")
    small_site(here)
    (here / "small.yaml").rename(here / "design.yaml")
    small_site(here, unknown="")
    (here / "small.yaml").rename(here / "known.yaml")
    (here / "profile.csv").write_text("x,y\n0,40\n20,25\n50,4\n80,0\n", encoding="utf-8")


def make_inputs(here: Path) -> None:
    """Write the inputs of all commands into the folder `here`, unless they are there."""

    def rock2d(*words: str) -> None:
        subprocess.run([sys.executable, "-m", "rock2d.cli", *words], check=True, stdout=subprocess.DEVNULL)

    write_scenarios(here)
    if not (here / "run").is_dir():
        options = ["--engine", "batch", "--releases", "3", "--quiet", "--out", str(here)]
        rock2d("run", str(here / "setup.yaml"), *options)
        (here / "paper_setup_batch").rename(here / "run")
    if not (here / "film.yaml").is_file():
        size = ["--size", "640", "400", "--releases", "2"]
        rock2d("film", str(here / "run"), "--quiet", *size, "--out", str(here / "film.avi"))
    if not (here / "tracks_0.txt").is_file():
        rock2d("export", str(here / "run"), "--out", str(here / "tracks.txt"))
    camera = {"scale": "{metres_per_pixel: 1.0}", "origin_px": "[0.0, 0.0]", "origin_m": "[0.0, 0.0]"}
    lines = (here / "film.yaml").read_text(encoding="utf-8").splitlines()
    keys = [line.strip().split(":")[0] for line in lines]
    metres = [f"  {key}: {camera[key]}" if key in camera else line for key, line in zip(keys, lines, strict=True)]
    (here / "metres.yaml").write_text("\n".join(metres), encoding="utf-8")  # the tracks are in metres
    if not (here / "trial").is_dir():
        rock2d("blind", "make", "--cases", "2", "--seed", "1", "--quiet", "--out", str(here / "long_trial"))
        for film in (here / "long_trial" / "cases").glob("*/*/trajectories.csv"):
            head, *rows = film.read_text(encoding="utf-8").splitlines()
            few = [row for row in rows if int(row.split(",")[0]) < FEW_RELEASES]
            film.write_text("\n".join([head, *few, ""]), encoding="utf-8")
        (here / "long_trial").rename(here / "trial")
    if not (here / "diagnosis" / "diagnosis.json").is_file():
        fit = str(here / "trial" / "cases" / "000" / "fit")
        rock2d("diagnose", fit, "--quiet", "--out", str(here / "diagnosis"))
    if not (here / "diagnosed_trial").is_dir():
        shutil.copytree(here / "trial", here / "copied_trial", dirs_exist_ok=True)
        rock2d("blind", "run", str(here / "copied_trial"), "--quiet")
        (here / "copied_trial").rename(here / "diagnosed_trial")
