"""Fixtures that several tests share, and one thread of linear algebra for all of them."""

import gc
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.browsing import browser  # noqa: F401, a fixture of all tests

# Matrices are small: a second thread only waits for the first, at twenty times the processor time. The workers of
# pytest and the commands that tests start have it, too. Before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
gc.set_threshold(50_000)  # the search for garbage is a twelfth of the time, and a third of that of collection

# Files that take longest come first, so that no worker is left alone with one of them at the end (`--durations` of the
# settings tells which). The second file needs nothing that the first compiles, so that no worker waits for the other.
FIRST = (
    "runs/campaigns/test_campaign.py", "engines/test_pymunk_engine.py", "blind/test_trial.py",
    "diagnosis/test_attribution.py", "field_tests/test_field_forecasts.py", "reproduction/test_reproduce.py",
    "hunt/test_faults.py", "runs/test_run.py", "blind/test_recovery.py", "hunt/test_loops.py",
    "tracking/test_following.py", "tracking/test_first_setup.py", "docs/test_tutorials.py", "tracking/test_command.py",
    "effects/test_catalogue.py", "engines/test_batch.py", "diagnosis/test_report.py", "diagnosis/test_live_gap.py",
    "diagnosis/test_cause_sets.py", "diagnosis/test_predict.py", "hunt/test_files.py", "design/test_least_size.py",
    "design/test_uncertainty.py", "design/test_several_embankments.py", "diagnosis/test_noise_free.py",
    "runs/test_acting_effects.py",
)  # fmt: skip
_TESTS = Path(__file__).parent
COARSE_DPI = 60


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the tests by their files: those of `FIRST`, then all others as they were found."""
    place = {_TESTS / name: k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: place.get(item.path, len(FIRST)))


def pytest_collection_finish() -> None:
    """What is imported stays: the search for garbage need not walk over it."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    """Compiled code runs on one thread: every core has a worker of pytest, and ensembles of tests are so small that
    threads cost more than they compute."""
    import numba

    numba.set_num_threads(1)


@pytest.fixture(scope="module", autouse=True)
def coarse_pictures() -> Iterator[None]:
    """Figures have few pixels and margins that do not fit their texts, and are drawn without a process of their own;
    videos have few frames: to draw them takes longer than most of what tests ask for. Tests of graphics see pictures as
    users do."""
    from rock2d.commands import run
    from rock2d.diagnosis.report import side_by_side
    from rock2d.graphics import figure_style, pages, plain_figure

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure_style, "FILE_DPI", COARSE_DPI)
        patch.setattr(figure_style.save_figure, "__defaults__", (COARSE_DPI,))
        patch.setattr(pages, "PAGE_FIGURE_DPI", COARSE_DPI)
        patch.setattr(plain_figure.PlainFigure, "get_layout_engine", lambda figure: None)
        patch.setattr(run, "FEWEST_FOR_PROCESS", float("inf"))
        patch.setattr(side_by_side, "VIDEO_S", 0.5)
        patch.setattr(side_by_side, "VIDEO_SIZE", (480, 240))
        yield


@pytest.fixture
def all_threads() -> Iterator[None]:
    """Compiled code runs on all threads, as for a user."""
    import numba

    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    yield
    numba.set_num_threads(1)


@pytest.fixture
def put(tmp_path: Path) -> Callable[..., Path]:
    """Write a text into a file of the test's folder; its path."""

    def write(text: str, name: str = "seen.csv") -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder that holds `data/` and `practice/`; tests that need real data are skipped without it."""
    root = os.environ.get("ROCK2D_DATA")
    if not root:
        pytest.skip("ROCK2D_DATA does not point to the folder that holds data/ and practice/")
    return Path(root)
