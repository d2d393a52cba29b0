"""A short film of a shaded ball that is thrown and bounces once."""

from pathlib import Path

import cv2
import numpy as np

SCALE, FPS = 0.004, 30.0
FALL_PX = 9.81 / SCALE / FPS**2
RADIUS_PX = 11.0
RESTITUTION, FLOOR_PX = 0.8, 280.0


def write_thrown_ball(path: Path) -> np.ndarray:
    """Write the film; returns the places (frames, 2) of the ball in px."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (480, 320))
    rng, places = np.random.default_rng(4), []
    u, v, vu, vv = 30.0, 150.0, 9.0, -14.0
    x, y = np.meshgrid(np.arange(480), np.arange(320))
    wall = 40 + 25 * np.sin(x / 37) * np.cos(y / 23)
    for _ in range(44):
        away = np.hypot(x - u, y - v)
        cover = np.clip(RADIUS_PX + 0.5 - away, 0, 1)
        frame = wall + cover * (150 - 5 * (x - u) - wall)
        noisy = np.clip(frame + rng.normal(0, 1.5, frame.shape), 0, 255).astype(np.uint8)
        writer.write(cv2.cvtColor(noisy, cv2.COLOR_GRAY2BGR))
        places.append((u, v))
        u, v, vv = u + vu, *_fallen(v, vv, 1.0)
    writer.release()
    return np.array(places)


def _fallen(v: float, vv: float, frames: float) -> tuple[float, float]:
    """Height and speed some frames later; the ball turns round at FLOOR_PX."""
    touch = (np.sqrt(vv**2 + 2 * FALL_PX * (FLOOR_PX - v)) - vv) / FALL_PX
    if touch >= frames:
        return v + vv * frames + 0.5 * FALL_PX * frames**2, vv + FALL_PX * frames
    return _fallen(FLOOR_PX, -RESTITUTION * (vv + FALL_PX * touch), frames - touch)
