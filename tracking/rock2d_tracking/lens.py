"""The bend that a lens gives to flights: what parabolas leave, compared with a radial distortion.

A picture with distortion k shows true (1 + k ρ²), ρ over half the diagonal of the picture. Of this bend a parabola
takes up the most; only what it leaves tells a lens from another scale. So k is known well only from long flights across
the picture. From flights of 10 frames at 30 frames per second its standard error is about 0.04, as much as the lens of
a phone has.
"""

from __future__ import annotations

import numpy as np

from rock2d.kinematics.flight_gravity import Measured
from rock2d.kinematics.flights import Film, Flights
from rock2d.records.columns import POSITION
from rock2d_tracking.camera import PixelMap

Array = np.ndarray

PARABOLA = 3  # coefficients
ROUNDS = 4  # in which places without the lens are found
CLEAR_ERRORS = 5.0  # standard errors from which on a bend counts
LEAST_EXPLAINED = 0.3  # share of the squares which parabolas leave that a lens must explain


def lens_bend(film: Film, flights: Flights, camera: PixelMap, size_px: tuple[int, int]) -> Measured | None:
    """Distortion k that explains what the parabolas of flights leave; None if none clearly does.

    camera : map of the places in the film, without distortion
    size_px : (width, height) of the picture
    """
    middle = 0.5 * (np.array(size_px) - 1.0)
    parts = list(zip(flights.first, flights.last, strict=True))
    freedom = sum(2 * (last - first - PARABOLA) for first, last in parts) - 1
    if freedom < 1:
        return None
    off = camera.to_pixel(film.pose[:, POSITION]) - middle
    left = _without_parabolas(film, parts, off)
    true, k = off, 0.0
    for _ in range(ROUNDS):
        share = (true**2).sum(axis=1, keepdims=True) / (middle**2).sum()
        bend = _without_parabolas(film, parts, share * true)
        k = float(bend @ left) / float(bend @ bend)
        true = off / (1.0 + k * share)
    squares, explained = float(left @ left), k * float(bend @ left)
    found = Measured(k, float(np.sqrt((squares - explained) / freedom / (bend @ bend))))
    clear = abs(k) > CLEAR_ERRORS * found.error and explained > LEAST_EXPLAINED * squares
    return found if clear else None


def _without_parabolas(film: Film, parts: list[tuple[int, int]], places: Array) -> Array:
    """What the parabola of each flight leaves of places (frames, 2), one after the other in a row."""
    found = []
    for first, last in parts:
        t_s = film.t_s[first:last]
        own = np.linalg.qr(np.vander((t_s - t_s.mean()) / np.ptp(t_s), PARABOLA))[0]
        found.append((places[first:last] - own @ (own.T @ places[first:last])).ravel())
    return np.concatenate(found)
