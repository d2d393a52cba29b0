"""Figures of a result as files: whichever process draws them they are the same, and what goes wrong is told."""

import multiprocessing
import os
import time

import pytest

from rock2d.errors import InputError
from rock2d.graphics.figure_files import Figures, NoFigures, figures_in_second_process
from rock2d.graphics.trajectories import trajectories_figure
from tests.graphics.flights import BLOCKS, FLOOR, flight
from tests.programs import commanded
from tests.scenarios_of_tests import SHIPPED

GIVEN = (trajectories_figure, FLOOR, BLOCKS, [flight("ball", 0), flight("cube", 1)], "two blocks")
RELEASES = 20  # of five blocks: enough that a second process draws


def refused(*given):
    raise InputError(f"no figure of {len(given)} things")


def refused_after_mark(mark):
    mark.write_text(str(os.getpid()))
    raise InputError("no figure from another process")


def dies_in_another_process(mark, *given):
    if multiprocessing.parent_process() is not None:
        mark.write_text(str(os.getpid()))
        os._exit(1)
    return trajectories_figure(*given)


def begun_elsewhere(mark):
    """Wait until another process draws: what it has not begun would be drawn here."""
    for _ in range(600):
        if mark.exists() and mark.read_text():
            return int(mark.read_text()) != os.getpid()
        time.sleep(0.1)
    return False


def ran(tmp_path, *words):
    options = f"--engine point_mass --releases {RELEASES} --quiet --out".split()
    return commanded("run", SHIPPED / "flat_floor.yaml", *options, tmp_path, *words)


def test_another_process_draws_the_same_and_each_file_once(tmp_path):
    here, names = Figures(), [f"{k}.png" for k in range(4)]
    with figures_in_second_process() as beside:
        for name in [*names, *names]:
            here.save(tmp_path / f"here_{name}", *GIVEN)
            beside.save(tmp_path / name, *GIVEN)
        beside.finish()
    pictures = {(tmp_path / f"{where}{name}").read_bytes() for where in ("", "here_") for name in names}
    assert len(pictures) == 1
    assert len(list(tmp_path.iterdir())) == 2 * len(names)


def test_an_error_of_another_process_is_raised_here(tmp_path):
    with pytest.raises(InputError, match="no figure from another process"), figures_in_second_process() as figures:
        figures.save(tmp_path / "a.png", refused_after_mark, tmp_path / "mark")
        assert begun_elsewhere(tmp_path / "mark")
        figures.finish()
    assert not list(tmp_path.glob("*.png"))


def test_what_a_dead_process_has_not_drawn_is_drawn_here(tmp_path):
    with figures_in_second_process() as figures:
        figures.save(tmp_path / "a.png", dies_in_another_process, tmp_path / "mark", *GIVEN[1:])
        assert begun_elsewhere(tmp_path / "mark")
        figures.finish()
        figures.save(tmp_path / "b.png", *GIVEN)
        figures.finish()
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_run_whose_figure_fails_says_so_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("rock2d.graphics.trajectories.trajectories_figure", refused)
    done = ran(tmp_path)
    assert isinstance(done.exception, InputError) and "no figure of 6 things" in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_without_figures_there_are_the_same_tables_and_a_page_without_pictures(tmp_path):
    for name, words in (("with", ()), ("without", ("--no-figures",))):
        done = ran(tmp_path / name, "--report", *words)
        assert done.exit_code == 0, done.output
    drawn, bare = ({p.name: p for p in (tmp_path / n / "flat_floor_point_mass").iterdir()} for n in ("with", "without"))
    assert {"trajectories.png", "stops.png"} <= {name for name in drawn if name not in bare}
    assert all(name.endswith(".png") for name in drawn if name not in bare)
    assert not any(name.endswith((".png", ".webm")) for name in bare)
    assert all(drawn[name].read_bytes() == bare[name].read_bytes() for name in bare if name.endswith(".csv"))
    assert "<img" in drawn["report.html"].read_text() and "<img" not in bare["report.html"].read_text()


def test_nothing_is_drawn_for_no_figures(tmp_path):
    figures = NoFigures()
    figures.save(tmp_path / "a.png", refused)
    figures.finish()
    assert not figures.wanted and not list(tmp_path.iterdir())
