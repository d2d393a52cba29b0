"""A first set-up file, from a film of which only the scale and the frame rate are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rock2d.errors import InputError
from rock2d.files.folders import write_whole
from rock2d_tracking.film_reading import FilmFile, Frames
from rock2d_tracking.motion import Motion, motion_of

GRAVITY_M_S2 = 9.81
GUESSED_DENSITY_KG_M3 = 1000.0
RESTS_RADII = 2.0  # from the lower edge of the picture, within which no ground was seen

TEXT = """\
# Written by `rock2d track` from the film alone. Lines with "guess" are to be replaced by what you know.
name: {name}
gravity_m_s2: 9.81
camera:
  fps: {fps:.9g}  # as stated: frames per second of the recording
  scale: {{metres_per_pixel: {scale:.9g}}}  # as stated
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


def first_motion(film: FilmFile, frames: Frames, metres_per_pixel: float, fps: float) -> Motion:
    """What moves in the frames of a film whose blocks are not known."""
    fall = GRAVITY_M_S2 / metres_per_pixel / fps**2
    return motion_of(frames, film.expected_frames, [], fall, fps)


def write_first_setup(
    path: Path, film: FilmFile, motion: Motion, metres_per_pixel: float, fps: float, size: float = 1.0
) -> None:
    """Write a set-up file with the size of what falls, and flat ground under its lowest place.

    `size`: factor on the size of its candidates.

    Raises `InputError` if nothing falls.
    """
    if not motion.chains:
        raise InputError(
            f"nothing was seen to fall in this film with {metres_per_pixel:g} m per pixel and {fps:g} frames/s",
            film.path,
        )
    width, height = film.size_px
    radius = float(np.median([np.sqrt(c.area_px2 / np.pi) for c in motion.chains])) * size
    lowest = max(float(a.places[:, 1].max()) for c in motion.chains for a in c.arcs) + radius
    lowest = max([lowest, *(float(p[1]) + radius for c in motion.chains for p in c.bounces())])
    seen = lowest < height - 1 - RESTS_RADII * radius
    ground_px = lowest if seen else height - 1 + RESTS_RADII * radius
    text = TEXT.format(
        name=_name(film.path.stem), fps=fps, scale=metres_per_pixel, bottom=height - 1,
        ground_from="guess: level, under the lowest place of the block" if seen
        else "guess: level, below the picture, because no bounce was seen",
        left=-width * metres_per_pixel, right=2 * width * metres_per_pixel,
        ground=(height - 1 - ground_px) * metres_per_pixel, radius_px=radius, diameter=2 * radius * metres_per_pixel,
        mass=GUESSED_DENSITY_KG_M3 * 4 / 3 * np.pi * (radius * metres_per_pixel) ** 3,
    )  # fmt: skip
    write_whole(path, text)


def _name(stem: str) -> str:
    kept = "".join(c if c.isalnum() or c in "_-" else "_" for c in stem)
    return kept if kept.strip("_-") and not kept.isdigit() else f"film_{kept}"
