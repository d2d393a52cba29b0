"""What moves in a film: arcs among clutter, bounces between two frames, shadows."""

import numpy as np
import pytest
from rock2d_tracking.candidates import CANDIDATE
from rock2d_tracking.film_scale import FilmScale
from rock2d_tracking.motion import arcs_of_other_gravity, find_arcs, find_chains, meeting, motion_of

FALL_PX = 2.0


def candidate(frame: int, u: float, v: float, area: float = 150.0, change: float = 80.0) -> np.ndarray:
    return np.array([(frame, (u, v), area, change, True, False)], CANDIDATE)


def fallen(
    frames: range, u0: float, v0: float, pace: tuple[float, float], fall: float
) -> dict[int, tuple[float, float]]:
    t = np.array(frames) - frames[0]
    return {f: (u0 + pace[0] * k, v0 + pace[1] * k + 0.5 * fall * k**2) for f, k in zip(frames, t, strict=True)}


def with_clutter(path: dict[int, tuple[float, float]], frames: int, seed: int) -> list[np.ndarray]:
    """A path among eight candidates a frame at random places, and a hand that moves evenly."""
    rng = np.random.default_rng(seed)
    table = []
    for f in range(frames):
        own = [candidate(f, *rng.uniform(0, 400, 2), rng.uniform(60, 300)) for _ in range(8)]
        own.append(candidate(f, 30 + 4 * f, 300.0, 160.0))
        own += [candidate(f, *path[f])] if f in path else []
        table.append(np.concatenate(own))
    return table


@pytest.mark.parametrize("seed", range(3))
def test_what_falls_is_found_among_clutter_and_a_hand(seed):
    path = fallen(range(3, 23), 40.0, 100.0, (12.0, -14.0), FALL_PX)
    chains = find_chains(find_arcs(with_clutter(path, 30, seed), FALL_PX), 30.0, [])
    block = max(chains, key=lambda c: c.frames_seen)
    assert block.first <= 4 and block.last >= 21
    for frame in range(5, 21):
        assert np.hypot(*(block.at(frame) - path[frame])) < 4.0
    hand = [a for c in chains for a in c.arcs if abs(a.curve[1, 1]) < 0.2 and a.falls]
    assert not hand


@pytest.mark.parametrize(("down_px", "shadow_px"), [(-4.0, None), (16.0, 35.0)])
def test_a_bounce_between_two_frames_joins_two_arcs(down_px, shadow_px):
    """Also where the shadow of the ball lies before the bounce where the second arc would have been."""
    down = fallen(range(0, 12), 20.0, 50.0, (10.0, 0.0), FALL_PX)
    u, v = down[11]
    up = fallen(range(12, 24), u + 10.0, v + down_px, (10.0, -18.0), FALL_PX)
    table = [candidate(f, *p) for f, p in sorted((down | up).items())]
    if shadow_px is not None:
        table[11] = np.append(table[11], candidate(11, u, v + shadow_px))
        assert [a.first for a in find_arcs(table, FALL_PX)].count(11) == 1
    (chain,) = find_chains(find_arcs(table, FALL_PX), 30.0, [])
    assert (chain.first, chain.last, len(chain.arcs)) == (0, 23, 2)
    bounce = chain.arcs[0].at(meeting(*chain.arcs))
    assert abs(bounce[0] - u) < 12 and bounce[1] > v - 12


def test_falls_with_another_gravity_are_no_release():
    path = fallen(range(0, 20), 40.0, 100.0, (12.0, -14.0), FALL_PX)
    table = [candidate(f, *p) for f, p in path.items()]
    assert find_chains(find_arcs(table, FALL_PX / 4), 30.0, []) == []
    (arc,) = arcs_of_other_gravity(table, FALL_PX / 4)
    assert arc.falls_otherwise and arc.gravity_ratio == pytest.approx(4.0, rel=0.02)


def test_of_a_ball_and_its_shadow_the_ball_is_the_release():
    import cv2

    rng = np.random.default_rng(2)
    wall = np.full((240, 400, 3), (120, 130, 140), np.uint8)
    path = fallen(range(0, 24), 30.0, 120.0, (13.0, -16.0), FALL_PX * 0.7)
    film = []
    for u, v in path.values():
        frame = wall.astype(float)
        soft = np.zeros((240, 400), np.float32)
        cv2.circle(soft, (int(u + 25), int(v + 15)), 13, 1.0, -1)
        frame *= 1.0 - 0.35 * cv2.GaussianBlur(soft, (0, 0), 4)[..., None]
        cv2.circle(frame, (int(u), int(v)), 10, (230, 230, 230), -1, cv2.LINE_AA)
        film.append(np.clip(frame + rng.normal(0, 1.5, frame.shape), 0, 255).astype(np.uint8))
    found = motion_of(film, len(film), [], FilmScale(9.81 / (FALL_PX * 0.7) / 30.0**2, 30.0))
    (chain,) = found.chains
    off = [np.hypot(*(chain.at(f) - path[f])) for f in range(chain.first, chain.last + 1)]
    assert chain.frames_seen > 15 and max(off) < 4.0
    assert any(own["shadow"].any() for own in found.candidates)


def test_the_block_is_chosen_not_its_highlight_nor_flicker():
    down = fallen(range(0, 20), 60.0, 40.0, (3.0, 0.0), FALL_PX)
    flicker = fallen(range(22, 34), 300.0, 40.0, (3.0, 0.0), FALL_PX)
    table = [np.empty(0, CANDIDATE)] * 36
    for f, (u, v) in down.items():
        highlight = candidate(f, u + 4, v - 5, area=15.0, change=160.0)
        table[f] = np.append(candidate(f, u, v, area=600.0), highlight)
    for f, (u, v) in flicker.items():
        table[f] = candidate(f, u, v, area=12.0, change=4.0)
    (chain,) = find_chains(find_arcs(table, FALL_PX), 30.0, [])
    assert chain.area_px2 == 600.0 and chain.last < 20
