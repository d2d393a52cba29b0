"""The commands `rock2d track`, `film`, `import` and `export`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rock2d.errors import InputError
from rock2d.files.experiment import Experiment, write_experiment_files
from rock2d.files.folders import atomic_folder
from rock2d_tracking import following as following
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.film_reading import FilmFile
from rock2d_tracking.setup_file import Setup

Array = np.ndarray
Report = Callable[[str], None]

FRAME = 0.08  # share of the picture that is left free around what moves


def track(video: Path, config: Path, out: Path, *, last: int | None, progress: bool, report: Report) -> None:
    """Track a film into the experiment folder `out`; whole or not at all.

    `last`: number of frames after which to stop. Raises `InputError` for input that cannot be used.
    """
    from tqdm import tqdm

    from rock2d_tracking.overlay import Overlay
    from rock2d_tracking.page import write_page
    from rock2d_tracking.recording import film_of, record
    from rock2d_tracking.velocities import flights_and_impacts

    setup = Setup(config)
    film = FilmFile(video)
    with atomic_folder(out) as folder:
        overlay = Overlay(folder / "overlay.webm", setup, film.size_px, film.promised)
        still: list[Array] = []
        try:
            with tqdm(total=film.promised or None, unit="frame", disable=not progress) as bar:

                def on_progress(number: int, frame: Array, path: following.Path | None) -> None:
                    if not still:
                        still.append(frame)
                    overlay.draw(number, frame, path)
                    bar.update()

                paths = following.follow(film.frames(last), setup, film.size_px, on_progress)
            try:
                found = record(paths, setup, film.size_px)
            except ValueError as error:
                raise InputError(str(error), video) from None
            overlay.finish()
        finally:
            overlay.drop()
        found.remarks.extend(_refuse_what_cannot_be(found.experiment, setup))
        flights, impacts, data = flights_and_impacts(film_of(found.experiment, setup), found.experiment)
        write_experiment_files(folder, found.experiment)
        for name, table in (("frames", found.frames), ("flights", flights), ("bounces", impacts)):
            table.to_csv(folder / f"{name}.csv", index=False, lineterminator="\n", float_format="%.9g")
        write_page(folder / "tracking.html", found, flights, impacts, data, still[0])
    trusted = (found.frames["reason"] == "").sum()
    report(
        f"{found.frames['release'].nunique()} releases, {trusted} of {len(found.frames)} frames trusted, "
        f"{len(flights)} flights, {len(impacts)} impacts"
    )
    for remark in found.remarks:
        report(f"note: {remark}")
    report(f"written: {out}")


def film(
    experiment_folder: Path, out: Path, *, size_px: tuple[int, int], faults: str, releases: int | None, seed: int,
    progress: bool, report: Report,
) -> None:  # fmt: skip
    """Film an experiment synthetically: `out` (AVI), its truth beside it (CSV), and a set-up file to track it with."""
    from tqdm import tqdm

    from rock2d.files.experiment import read_experiment
    from rock2d_tracking.setup_writing import write_setup
    from rock2d_tracking.synthetic.faults import CLEAN, MODERATE, SEVERE
    from rock2d_tracking.synthetic.film import film_frames, write_film

    experiment = read_experiment(experiment_folder)
    if experiment.trajectories is None:
        raise InputError("has impacts only; trajectories can be filmed", experiment_folder)
    numbers = experiment.trajectories["release"].unique()[:releases].tolist()
    camera = _whole_view(experiment, size_px)
    spoiled = {"clean": CLEAN, "moderate": MODERATE, "severe": SEVERE}[faults]
    shots = film_frames(
        experiment, camera, size_px, faults=spoiled, seed=seed, releases=numbers, rest_frames=60
    )
    with tqdm(unit="frame", disable=not progress) as bar:

        def counted():
            for shot in shots:
                bar.update()
                yield shot

        write_film(out, counted(), size_px, 25, spoiled.quality, truth=True)
    setup = out.with_suffix(".yaml")
    first = experiment.trajectories.groupby("release")["block"].first()
    write_setup(setup, experiment, camera, [str(first[n]) for n in numbers])
    report(f"written: {out}, {out.with_suffix('.csv')} (truth), {setup}")


def _whole_view(experiment: Experiment, size_px: tuple[int, int]) -> PixelMap:
    """A camera that sees all that moves."""
    table = experiment.trajectories
    assert table is not None
    reach = max(b.radius_m for b in experiment.blocks.values())
    low = np.array([table["x_m"].min(), table["y_m"].min()]) - 2 * reach
    high = np.array([table["x_m"].max(), table["y_m"].max()]) + 2 * reach
    scale = float(((high - low) / ((1 - 2 * FRAME) * np.array(size_px))).max())
    return PixelMap(scale, (FRAME * size_px[0], (1 - FRAME) * size_px[1]), (float(low[0]), float(low[1])))


def import_files(
    files: Sequence[Path], kind: str, config: Path, out: Path, *, y: str, block: str | None, marks: Sequence[str],
    centroid: Sequence[str], file_fps: float | None, min_confidence: float | None, gap_frames: int | None, report:
Report, ) -> None:  # fmt: skip
    """Turn what another program tracked into the experiment folder `out`; scale and frame rate are the set-up's."""
    from rock2d_tracking.importers.importing import import_tracks
    from rock2d_tracking.recording import film_of, with_measured_noise

    setup = Setup(config)
    name = block or setup.block_of(0)
    if name not in setup.blocks:
        raise InputError(f"no block {name!r} in it; it has {', '.join(setup.blocks)}", config)
    camera = setup.keys.camera
    table = import_tracks(
        files, kind, metres_per_unit=setup.metres_per_pixel, y=y, fps=camera.fps, block=setup.blocks[name], marks=marks,
        centroid=centroid, origin=(camera.origin_px[0], camera.origin_px[1]),
        origin_m=(camera.origin_m[0], camera.origin_m[1]), file_fps=file_fps, min_confidence=min_confidence,
        gap_frames=gap_frames, report=report,
    )  # fmt: skip
    stated = Experiment(
        setup.keys.name, setup.keys.gravity_m_s2, camera.fps, setup.metres_per_pixel, np.deg2rad(1.0),
        setup.cross_section, {name: setup.blocks[name]}, trajectories=table,
    )  # fmt: skip
    found = with_measured_noise(film_of(stated, setup), stated)
    _refuse_what_cannot_be(found, setup)
    with atomic_folder(out) as folder:
        write_experiment_files(folder, found)
    report(f"{table['release'].nunique()} releases, {len(table)} frames")
    report(f"written: {out}")


def export_tracker(experiment_folder: Path, out: Path, *, report: Report) -> None:
    """Write the trajectories of an experiment for Tracker (Open Source Physics)."""
    from rock2d.files.experiment import read_experiment
    from rock2d_tracking.importers.tracker_text import write_tracker

    experiment = read_experiment(experiment_folder)
    if experiment.trajectories is None:
        raise InputError("has impacts only; Tracker takes trajectories", experiment_folder)
    for path in write_tracker(out, experiment.trajectories, experiment.fps):
        report(f"written: {path}")


def _refuse_what_cannot_be(experiment: Experiment, setup: Setup) -> list[str]:
    """Remarks on an experiment; raises `InputError` where frame rate, scale or axes must be wrong."""
    from rock2d.kinematics.sanity import FEW_RELEASES, check_film
    from rock2d_tracking.recording import film_of

    sanity = check_film(experiment, film_of(experiment, setup))
    wrong = [fault.message for fault in sanity.faults if fault.code != FEW_RELEASES]
    if wrong:
        raise InputError("; ".join(wrong), setup.path)
    if sanity.mirror:
        raise InputError(
            f"seen with {sanity.mirror} mirrored, blocks would fall and stay above the ground: "
            "does the film stand on its head (camera: up), or is it filmed from behind?",
            setup.path,
        )
    if sanity.registered is not None:
        raise InputError(sanity.remarks[-1], setup.path)
    return sanity.remarks
