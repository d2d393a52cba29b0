"""Trial of the tracker on films as hard as reality: `python -m tests.tracking.look_trial --looks 20 --seed 0`.

For each look and severity: share of the free frames that are trusted, root mean square error of a coordinate, frames
that are off by more than 2 px among the trusted, and errors over their standard errors, with what all frames may be off
alike.

`--films 4 --seed 0` tries films as users make them, with the command and from scale and frame rate alone. For each kind
of film: films tracked, share of the free frames that are trusted, offset that all frames share, root mean square error
beside it, frames that are off by more than 3 px, errors over their standard errors (median; root mean square), films
with g within two standard errors (without wide angles, where no one scale is right), films with the frame rate within
two standard errors, where the user states a wrong one, error of the restitution and
number of bounces, impacts where there was none."""

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.setup_file import Setup, write_setup
from rock2d_tracking.tracked_film import moving_releases

from rock2d.files.experiment import Experiment
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection
from tests.tracking import real_looks
from tests.tracking.falls import followed
from tests.tracking.user_film_outcomes import outcome_line, tracked_by_command
from tests.tracking.user_films import FILM_KINDS, drawn_user_film

Array = np.ndarray

SIZE_PX, FRAMES = (480, 320), 70
METRES_PER_PIXEL = 1e-3
WRONG_PX = 2.0


@dataclass
class Outcome:
    """What was made of one film: free frames, trusted free frames, errors in px and over their standard errors."""

    look: real_looks.RealLook
    kind: str
    size: float
    free: int
    found: int
    misses: Array
    ratios: Array

    @property
    def wrong(self) -> int:
        """Trusted frames that are off by more than `WRONG_PX`."""
        return int((np.hypot(*self.misses.T) > WRONG_PX).sum()) if len(self.misses) else 0


def stated_block(look: real_looks.RealLook) -> Block:
    """The block as a set-up file states it, in a size that is a little wrong."""
    a, b = np.array(real_looks.half_axes_px(look)) * METRES_PER_PIXEL * look.stated_size
    if look.shape == "circle":
        return make_block("block", "circle", 0.1, "solid_sphere", diameter_m=2 * a)
    if look.shape == "square":
        return make_block("block", "square", 0.1, side_m=2 * a)
    return make_block("block", "rectangle", 0.1, length_m=2 * a, height_m=2 * b)


def setup_of(look: real_looks.RealLook, folder: Path) -> Setup:
    """The set-up file of a film of this look."""
    fps = float(np.sqrt(9.81 / METRES_PER_PIXEL / look.g_px_frame2))
    block = stated_block(look)
    ground = CrossSection([[-1.0, -1.0], [2.0, -1.0]], ["floor"])
    rest = pd.DataFrame({
        "release": [0, 0], "block": "block", "t_s": [0.0, 1.0], "x_m": 0.0, "y_m": 0.0, "theta_rad": 0.0
    })  # fmt: skip
    experiment = Experiment("look", 9.81, fps, 1e-3, 1e-2, ground, {"block": block}, trajectories=rest)
    path = folder / "setup.yaml"
    write_setup(path, experiment, PixelMap(METRES_PER_PIXEL, (0.0, float(SIZE_PX[1]))), ["block"])
    text = path.read_text()
    path.write_text(text if "detection" in text else text + "detection: {marks: false}\n")
    return Setup(path)


def tracked(look: real_looks.RealLook, film: list[real_looks.RealFrame]) -> Outcome:
    """Track a film and compare it with the truth."""
    with tempfile.TemporaryDirectory() as folder:
        setup = setup_of(look, Path(folder))
    follower = followed([f.image for f in film], setup, SIZE_PX)
    looks = follower.looks["block"]
    misses, ratios, found = [], [], set()
    for release in moving_releases(follower.releases, look.g_px_frame2):
        for sight in release.seen:
            off = sight.pose[:2] - film[sight.frame].pose[:2]
            misses.append(off)
            ratios.append(off / np.hypot(sight.error[:2], release.bias_px))
            found.add(sight.frame)
    free = {i for i, f in enumerate(film) if f.free}
    return Outcome(look, looks.kind, looks.size, len(free), len(found & free),
                   np.array(misses).reshape(-1, 2), np.array(ratios).reshape(-1, 2))  # fmt: skip


def main() -> None:
    """Run the trial and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--looks", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--severities", nargs="+", default=list(real_looks.LOOK_SEVERITIES))
    parser.add_argument("--films", type=int, default=0, help="films of each kind that users make; no looks then")
    parser.add_argument("--kinds", nargs="+", default=list(FILM_KINDS))
    chosen = parser.parse_args()
    if chosen.films:
        _try_user_films(chosen.films, chosen.kinds, chosen.seed)
        return
    for severity in chosen.severities:
        outcomes = []
        for index in range(chosen.looks):
            look = real_looks.drawn_look(index, severity, chosen.seed)
            found = tracked(look, list(real_looks.real_film(look, SIZE_PX, FRAMES)))
            outcomes.append(found)
            print(_line(f"{severity} {index} {look.kind} {look.shape} r {look.radius_px:.1f}", [found]), flush=True)
        print(_line(f"{severity}: all", outcomes), flush=True)


def _try_user_films(films: int, kinds: list[str], seed: int) -> None:
    everything = []
    for kind in kinds:
        outcomes = []
        for index in range(films):
            with tempfile.TemporaryDirectory() as folder:
                outcomes.append(tracked_by_command(drawn_user_film(kind, index, seed), Path(folder)))
            look = outcomes[-1].film.look
            print(outcome_line(f"  {index} {look.kind} r {look.radius_px:.1f}", outcomes[-1:]), flush=True)
            if not outcomes[-1].tracked:
                print(f"    {outcomes[-1].said}", flush=True)
        print(outcome_line(kind, outcomes), flush=True)
        everything += outcomes
    print(outcome_line("all", everything), flush=True)


def _line(name: str, outcomes: list[Outcome]) -> str:
    off = np.concatenate([o.misses for o in outcomes])
    ratios = np.concatenate([o.ratios for o in outcomes])
    free, found = sum(o.free for o in outcomes), sum(o.found for o in outcomes)
    wrong = sum(o.wrong for o in outcomes)
    rms = np.sqrt((off**2).mean()) if len(off) else np.nan
    honest = np.sqrt(np.median(ratios**2) / 0.4549) if len(off) else np.nan
    spread = np.sqrt((ratios**2).mean()) if len(off) else np.nan
    sizes = ", ".join(f"{o.kind} {o.size * o.look.stated_size:.3f}" for o in outcomes) if len(outcomes) == 1 else ""
    return (
        f"{name:42s} trusted {found:5d}/{free:5d} = {found / max(free, 1):.3f}  rms {rms:.3f} px  "
        f"wrong {wrong} of {len(off)}  error/se {honest:.2f} (median) {spread:.2f} (rms)  {sizes}"
    )


if __name__ == "__main__":
    main()
