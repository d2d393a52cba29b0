"""Make the pictures of the documentation: one for each scenario and engine, and the output of the tutorials.

    python docs/make_gallery.py            # all of it, into docs/pictures and docs/tutorials
    python docs/make_gallery.py flat_floor # one scenario or tutorial
    python docs/make_gallery.py --live     # the live pages, into docs/live; those that are older than what they show

Scenarios with measured data need the data folder in the variable ROCK2D_DATA.
"""

from __future__ import annotations

import contextlib
import io
import os
import runpy
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rock2d import load_scenario, run
from rock2d.graphics.figure_style import save_figure

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
PICTURES = DOCS / "pictures"
LIVE = DOCS / "live"  # pages too large to be kept in the repository
COMPARED = "run scenarios/{}.yaml --report --compare --engine batch"
LIVE_COMMANDS = {  # page -> the command of rock2d that makes it
    **{name: COMPARED.format(name) for name in ("flat_floor", "paper_setup", "rough_slope", "slope_embankment")},
    "design_site": "design scenarios/design_site.yaml --range 3 9 --target 1 --confidence 95",
}
RELEASES = 40
COLOURS, WIDTH_PX = 96, 1100


def main(wanted: list[str]) -> None:
    """Make all pictures, or those of the scenarios and tutorials named, or the live pages."""
    if wanted == ["--live"]:
        return live_pages()
    PICTURES.mkdir(exist_ok=True)
    for path in sorted((DOCS.parent / "scenarios").glob("*.yaml")):
        if not wanted or path.stem in wanted:
            scenario_pictures(path)
    if not wanted or "design_curve" in wanted:
        design_picture(DOCS.parent / "scenarios" / "design_site.yaml")
    for path in sorted((DOCS / "tutorials").glob("*.py")):
        if not wanted or path.stem in wanted:
            run_tutorial(path)


def scenario_pictures(path: Path) -> None:
    """A picture of the scenario for each kind of law that it has parameters for."""
    scenario = load_scenario(path)
    if scenario.experiment is not None:
        result = run(scenario, engine="batch", releases=60)
        with tempfile.TemporaryDirectory() as folder:
            result.write(Path(folder) / "run")
            keep(Path(folder) / "run" / "overlay.png", PICTURES / f"{path.stem}_batch.png")
        return
    for engine, law in (("batch", "deterministic"), ("point_mass", "probabilistic")):
        if getattr(scenario.model, law) is None and scenario.model.soils is None:
            continue
        figure = run(scenario, engine=engine, releases=min(RELEASES, scenario.releases)).plot()
        with tempfile.TemporaryDirectory() as folder:
            keep(save_figure(figure, Path(folder) / "it.png"), PICTURES / f"{path.stem}_{engine}.png")


def design_picture(path: Path) -> None:
    """The curve of the design question that the README asks."""
    from rock2d.design.command import run_design
    from rock2d.design.least_size import Target

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "design"
        run_design(path, "embankment.height_m", (2.0, 8.0), Target("crest", 0.01, 0.95), out)
        keep(out / "design.png", PICTURES / "design_curve.png")


def run_tutorial(path: Path) -> None:
    """Run a tutorial and keep what it prints and draws."""
    said = io.StringIO()
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.symlink(DOCS.parent / "scenarios", Path(folder) / "scenarios")
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(said):
                runpy.run_path(str(path), run_name="__main__")
        finally:
            os.chdir(here)
        for picture in sorted(Path(folder).glob("*.png")):
            keep(picture, PICTURES / f"tutorial_{path.stem}_{picture.stem}.png")
    path.with_suffix(".txt").write_text(said.getvalue(), encoding="utf-8")


def live_pages() -> None:
    """Make the live pages that are missing or older than the file that they come from."""
    LIVE.mkdir(exist_ok=True)
    for name, command in LIVE_COMMANDS.items():
        target = LIVE / f"{name}.html"
        if not _is_new(target, ROOT / "scenarios" / f"{name}.yaml"):
            with tempfile.TemporaryDirectory() as folder:
                full = [sys.executable, "-m", "rock2d.cli", *command.split(), "--out", f"{folder}/out"]
                subprocess.run(full, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
                (page,) = Path(folder).rglob("report.html")
                shutil.copyfile(page, target)
    tutorial, target = DOCS / "tutorials" / "diagnosis.py", LIVE / "diagnosis.html"
    if not _is_new(target, tutorial):
        silent = contextlib.redirect_stdout(io.StringIO())
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(ROOT), silent:
            runpy.run_path(str(tutorial))["found"].write(folder)
            shutil.copyfile(Path(folder) / "report.html", target)


def _is_new(page: Path, source: Path) -> bool:
    return page.is_file() and page.stat().st_mtime > source.stat().st_mtime


def keep(source: Path, target: Path) -> None:
    """A small copy of a picture: at most WIDTH_PX wide, COLOURS colours."""
    from PIL import Image

    with Image.open(source) as picture:
        small = picture.convert("RGB")
    if small.width > WIDTH_PX:
        small = small.resize((WIDTH_PX, round(small.height * WIDTH_PX / small.width)), Image.Resampling.LANCZOS)
    small.quantize(COLOURS, dither=Image.Dither.NONE).save(target, optimize=True)
    print(f"{target.name}: {target.stat().st_size / 1000:.0f} kB", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
