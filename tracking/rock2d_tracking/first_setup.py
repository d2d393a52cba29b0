"""The first set-up file of a film of which only scale and frame rate are known."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.files.setup_keys import LONGEST_NAME
from rock2d_tracking import FROM_GRAVITY
from rock2d_tracking.film_reading import FilmFile
from rock2d_tracking.film_scale import FilmScale
from rock2d_tracking.gross_errors import bounces_of
from rock2d_tracking.motion import Motion
from rock2d_tracking.setup_file import SETUP, Setup
from rock2d_tracking.sights import FollowedRelease

GUESSED_DENSITY_KG_M3 = 1000.0
BELOW_RADII = 0.5  # a block whose middle comes nearer than this to the ground was below it
UNSEEN_RADIUS_SHARE = 0.02  # radius of a ball that was not seen, over the width of the picture
RESTS_RADII = 2.0  # distance below the picture of a ground that was not seen

TEXT = """\
# Written by `rock2d track` from the film alone. Lines with "guess" are to be replaced by what you know.
name: "{name}"
gravity_m_s2: {gravity:g}
camera:
  fps: {fps}  # frames per second of the recording: {rate_from}
  scale: {{metres_per_pixel: {scale}}}  # {scale_from}
  up: up
  origin_px: [0, {bottom}]  # lower left corner of the picture ...
  origin_m: [0.0, 0.0]  # ... is the origin
cross_section:
  # {ground_from}
  points_m: [[{left:.6g}, {ground:.6g}], [{right:.6g}, {ground:.6g}]]
  zones: [floor]
blocks:
  # guess: a ball, as large as what falls in the film ({radius_px:.1f} px radius); mass as of water
  ball: {{shape: circle, diameter_m: {diameter:.6g}, mass_kg: {mass:.6g}, inertia: solid_sphere}}
releases: [ball]
detection: {{marks: false}}  # true if the block carries marks from which its turn can be read
"""


@dataclass(frozen=True)
class FirstSetup:
    """The contents of the first set-up file of a film.

    Attributes
    ----------
    asked : scale and frame rate as stated; one may be unknown
    scale : both, one of them possibly computed from gravity
    size : factor on the size of the candidates
    ground_px : height of the ground in the picture; None if no bounce was seen"""

    film: FilmFile
    motion: Motion
    asked: FilmScale
    scale: FilmScale
    size: float = 1.0
    ground_px: float | None = None

    def setup(self) -> Setup:
        """The set-up, as read from its text."""
        return Setup(SETUP, _text(self)).with_scale(self.scale)


def _text(first: FirstSetup) -> str:
    film, motion, (metres_per_pixel, fps, gravity) = first.film, first.motion, first.scale
    assert metres_per_pixel is not None and fps is not None
    width, height = film.size_px
    arcs = [a for a in motion.arcs if a.falls or a.falls_otherwise]
    areas = [own.area_px2 for own in motion.chains or arcs]
    radius = float(np.sqrt(np.median(areas) / np.pi)) * first.size if areas else UNSEEN_RADIUS_SHARE * width
    seen = first.ground_px is not None
    ground = first.ground_px if first.ground_px is not None else height - 1 + RESTS_RADII * radius
    return TEXT.format(
        name=_name(film.path.stem), gravity=gravity, bottom=height - 1,
        fps=FROM_GRAVITY if first.asked.fps is None else f"{fps:.9g}",
        scale=FROM_GRAVITY if first.asked.metres_per_pixel is None else f"{metres_per_pixel:.9g}",
        rate_from=f"{fps:.6g}, as what falls gives" if first.asked.fps is None else "as stated",
        scale_from=f"{metres_per_pixel:.6g} m, as what falls gives" if first.asked.metres_per_pixel is None
        else "as stated",
        ground_from="guess: level, under the lowest bounce" if seen
        else "guess: level, below the picture, because no bounce was seen",
        left=-width * metres_per_pixel, right=2 * width * metres_per_pixel,
        ground=(height - 1 - ground) * metres_per_pixel, radius_px=radius, diameter=2 * radius * metres_per_pixel,
        mass=GUESSED_DENSITY_KG_M3 * 4 / 3 * np.pi * (radius * metres_per_pixel) ** 3,
    )  # fmt: skip


def ground_of(releases: Sequence[FollowedRelease], g_px_frame2: float) -> float | None:
    """Height of the ground in the picture, from the lowest bounce of some releases; None if none bounced or a block was
    seen below."""
    feet = [float(place[1]) + r.radius_px for r in releases for place in bounces_of(r.seen, g_px_frame2)]
    if not feet:
        return None
    lowest = max(float(s.pose[1]) + BELOW_RADII * r.radius_px for r in releases for s in r.seen)
    return max(feet) if lowest < max(feet) else None


def _name(stem: str) -> str:
    kept = "".join(c if c.isalnum() or c in "_-" else "_" for c in stem)
    return kept[:LONGEST_NAME] if kept.strip("_-") else "film"
