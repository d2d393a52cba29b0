"""The commands `rock2d track`, `film`, `import` and `export`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rock2d.errors import InputError, comma_list, counted
from rock2d.files.experiment import Experiment, write_experiment_files
from rock2d.files.folders import atomic_folder, check_file, check_folder, check_own_file
from rock2d.progress import Bars
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.film_scale import FilmScale
from rock2d_tracking.setup_file import SETUP, Setup

if TYPE_CHECKING:
    from rock2d.kinematics.film_findings import FilmFindings
    from rock2d_tracking.importing import ImportOptions, TrackedFiles

Report = Callable[[str], None]

IMPORTED = "imported tracks"  # kind of a folder of results
VIEW_MARGIN = 0.08  # empty share of the picture on each side of the motion
FILM_REST_FRAMES = 60  # empty frames before each release of a synthetic film
FILM_PLAYED_FPS = 25


class FilmFormat(NamedTuple):
    """Format of a synthetic film: size of its pictures (width, height) and number of releases, None for all."""

    size_px: tuple[int, int]
    releases: int | None


@dataclass(frozen=True)
class TrackSettings:
    """How to track.

    Attributes
    ----------
    last : number of frames after which to stop, None for all
    explain : whether to write the explanation of the tracking also if it succeeds
    progress : whether to show a progress bar
    report : called with every line for the user"""

    last: int | None = None
    explain: bool = False
    progress: bool = False
    report: Report = print


def track(video: Path, config: Path | FilmScale, out: Path, settings: TrackSettings) -> None:
    """Track a film and write the experiment folder `out`, completely or not at all.

    `config`: the set-up file; or scale and frame rate, from which a set-up file is written into `out`. If one of the
    two is unknown, it is computed from gravity. If nothing can be tracked, an explanation is written to
    `OUT_explained`. Raises InputError for invalid input."""
    from rock2d_tracking.explanation import write_explanation
    from rock2d_tracking.film_tracking import TRACKED, NotTrackedError, track_film

    check_folder(out, TRACKED)
    known = Setup(config) if isinstance(config, Path) else config
    try:
        found, seen = track_film(video, known, settings.last, progress=settings.progress)
    except NotTrackedError as error:
        folder = out.with_name(f"{out.name}_explained")
        error.write(folder)
        raise InputError(f"{error.message}. What was seen: {folder}", error.file) from None
    counts, report = found.counts(), settings.report

    def explain(folder: Path) -> None:
        if settings.explain:
            write_explanation(folder, seen, counts)

    found.write(out, explain)
    report(counts)
    _report_findings(found.film.findings, report)
    for remark in found.film.remarks:
        report(f"note: {remark}")
    report(f"written: {out}")
    if not isinstance(config, Path):
        report(f"set-up file to refine: {out / SETUP}")


def _report_findings(said: FilmFindings, report: Report) -> None:
    for line in said.sentences():
        report(f"film: {line}")


def film(
    experiment_folder: Path,
    out: Path,
    film_format: FilmFormat,
    *,
    faults: str,
    seed: int,
    progress: bool,
    report: Report,
) -> None:
    """Film an experiment synthetically: `out` (AVI), its truth beside it (CSV), and a set-up file to track it with.

    `faults`: one of `FAULT_LEVELS`. Raises `InputError` for an experiment that cannot be filmed."""
    from rock2d.files.experiment import load_experiment, seen_frames
    from rock2d_tracking.setup_file import write_setup
    from rock2d_tracking.synthetic.faults import FAULT_LEVELS
    from rock2d_tracking.synthetic.film import TRUTH_COLUMNS, FilmOptions, film_frames, write_film

    experiment = load_experiment(experiment_folder)
    if experiment.trajectories is None:
        raise InputError("holds impacts only; an experiment with trajectories is needed", experiment_folder)
    table = seen_frames(experiment)
    experiment = replace(experiment, trajectories=table)
    truth, setup = out.with_suffix(".csv"), out.with_suffix(".yaml")
    for path in (out, truth, setup):
        check_file(path)
    check_own_file(truth, ",".join(TRUTH_COLUMNS), out, setup)
    numbers = table["release"].unique()[: film_format.releases].tolist()
    camera = _whole_view(experiment, film_format.size_px)
    options = FilmOptions(seed, FAULT_LEVELS[faults], releases=numbers, rest_frames=FILM_REST_FRAMES)
    shots = film_frames(experiment, camera, film_format.size_px, options)
    length = int(table["release"].isin(numbers).sum()) + FILM_REST_FRAMES * len(numbers)
    with Bars(progress).stage("filming", length, "frames") as bar:
        size_px, quality = film_format.size_px, options.faults.quality
        write_film(out, bar.counted(shots), size_px, FILM_PLAYED_FPS, quality)
    first = table.groupby("release")["block"].first()
    filmed = [str(first[n]) for n in numbers]
    blocks = {name: block for name, block in experiment.blocks.items() if name in filmed}
    write_setup(setup, replace(experiment, blocks=blocks), camera, filmed)
    report(f"written: {out}, {truth} (truth), {setup}")


def _whole_view(experiment: Experiment, size_px: tuple[int, int]) -> PixelMap:
    """A camera whose picture contains the whole motion."""
    table = experiment.trajectories
    assert table is not None
    reach = max(b.radius_m for b in experiment.blocks.values())
    low = np.array([table["x_m"].min(), table["y_m"].min()]) - 2 * reach
    high = np.array([table["x_m"].max(), table["y_m"].max()]) + 2 * reach
    scale = float(((high - low) / ((1 - 2 * VIEW_MARGIN) * np.array(size_px))).max())
    return PixelMap(scale, (VIEW_MARGIN * size_px[0], (1 - VIEW_MARGIN) * size_px[1]), (float(low[0]), float(low[1])))


def import_files(
    files: TrackedFiles, config: Path, out: Path, options: ImportOptions, *, block: str | None = None, report: Report
) -> None:
    """Convert the tracks of another program to the experiment folder `out`; the set-up gives frame rate and camera.

    `block`: name of the block; needed if the releases of the set-up are of several. Raises InputError for invalid
    input."""
    from rock2d.kinematics.film_findings import write_film_findings
    from rock2d_tracking.importing import import_tracks
    from rock2d_tracking.tracked_film import check_sanity, findings_of, with_measured_noise

    setup = Setup(config)
    if setup.from_gravity is not None:
        raise InputError("import needs scale and frame rate: gravity gives them only of a film", config)
    check_folder(out, IMPORTED)
    if block is None and len(named := list(dict.fromkeys(setup.keys.releases))) > 1:
        raise InputError(f"--block: the releases are of several blocks, expected one of {comma_list(named)}", config)
    name = block or setup.block_of(0)
    if name not in setup.blocks:
        raise InputError(f"--block: expected one of {', '.join(setup.blocks)}, found {name!r}", config)
    camera = setup.pixel_map(None)
    camera = replace(camera, up=-camera.up) if files.y == "up" else camera
    table = import_tracks(files, camera, setup.fps, setup.blocks[name], options, report=report)
    stated = Experiment(
        setup.keys.name, setup.keys.gravity_m_s2, setup.fps, setup.metres_per_pixel, np.deg2rad(1.0),
        setup.cross_section, {name: setup.blocks[name]}, trajectories=table,
    )  # fmt: skip
    found = with_measured_noise(stated, setup)
    check_sanity(found, setup)
    _, said = findings_of(found, setup)
    with atomic_folder(out, IMPORTED) as folder:
        write_experiment_files(folder, found)
        write_film_findings(folder, said)
    report(f"{counted(table['release'].nunique(), 'release')}, {counted(len(table), 'frame')}")
    _report_findings(said, report)
    report(f"written: {out}")


def export_tracker(experiment_folder: Path, out: Path, *, report: Report) -> None:
    """Write the trajectories of an experiment for Tracker (Open Source Physics)."""
    from rock2d.files.experiment import load_experiment, seen_frames
    from rock2d_tracking.importers.tracker import write_tracker

    experiment = load_experiment(experiment_folder)
    if experiment.trajectories is None:
        raise InputError("holds impacts only; Tracker needs an experiment with trajectories", experiment_folder)
    check_file(out)
    for path in write_tracker(out, seen_frames(experiment), experiment.fps):
        report(f"written: {path}")
