"""The centre of a learned picture is where its edge is, not where its light is."""

import numpy as np
import pytest
from rock2d_tracking.background import Background
from rock2d_tracking.fitting import Fitter
from rock2d_tracking.learning import _centre_of_picture
from rock2d_tracking.looks import BlockFrame, Looks
from rock2d_tracking.outline import outline_of

from rock2d.scene.blocks import make_block

RADIUS_PX = 18.0
HEIGHT, WIDTH = 160, 240
WALL = 120.0


def half_transparent_ball(place: tuple[float, float]) -> np.ndarray:
    """Brighter than the wall at its top, darker at its foot, as bright as the wall between them."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    x, y = (u - place[0]) / RADIUS_PX, (v - place[1]) / RADIUS_PX
    share = np.clip((1.0 - np.hypot(x, y)) * RADIUS_PX + 0.5, 0.0, 1.0)
    return WALL + share * (25.0 - 45.0 * (y + 0.3 * x))


@pytest.mark.parametrize("off", [(0.0, 0.0), (3.0, -4.0), (-2.0, 4.5)])
def test_the_centroid_is_found_where_arcs_lead_beside_it(off):
    rng = np.random.default_rng(2)

    def noisy(picture: np.ndarray) -> np.ndarray:
        return np.clip(np.rint(picture + rng.normal(0, 1.0, picture.shape)), 0, 255).astype(np.uint8)

    background = Background([noisy(np.full((HEIGHT, WIDTH), WALL)) for _ in range(9)])
    fitter = Fitter(background, np.ones((HEIGHT, WIDTH), np.uint8), 0.55)
    ball = make_block("ball", "circle", 0.1, "solid_sphere", diameter_m=2 * RADIUS_PX * 1e-3)
    looks = Looks("outline", outline_of(ball, 1e-3, 1))
    places = np.column_stack([np.linspace(60, 180, 9), np.linspace(60, 100, 9)])
    frames = [
        BlockFrame(k, noisy(half_transparent_ball((u, v))), np.array([u, v]) + off, np.zeros(2))
        for k, (u, v) in enumerate(places)
    ]
    centre, error = _centre_of_picture(fitter, looks, frames)
    miss = np.abs(np.add(centre, off))
    assert miss.max() < 0.6
    assert miss.max() < 3.0 * error
