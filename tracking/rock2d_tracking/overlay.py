"""The film with the tracked outlines drawn into it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rock2d.graphics.video_file import VideoWriter
from rock2d_tracking.setup_file import Setup
from rock2d_tracking.sights import FollowedRelease

Array = np.ndarray

OVERLAY_WIDTH_PX = 560
SEEN_BGR, LOST_BGR, TRAIL_BGR = (60, 200, 60), (40, 40, 230), (230, 160, 0)
OVERLAY_FRAMES = 500  # about the most pictures; of a longer film every second, third ... is drawn
OVERLAY_FPS = 25.0
TRAIL_FRAMES = 300  # length of the trail behind a block
OUTLINE_POINTS = 48


class Overlay:
    """Writes a WebM frame by frame, until `close`."""

    def __init__(self, path: Path, setup: Setup, size_px: tuple[int, int], expected_frames: int) -> None:
        self._scale = min(1.0, OVERLAY_WIDTH_PX / size_px[0])
        self._size = (int(size_px[0] * self._scale) // 2 * 2, int(size_px[1] * self._scale) // 2 * 2)
        self._stride = max(1, -(-expected_frames // OVERLAY_FRAMES))
        self._writer = VideoWriter(path, OVERLAY_FPS, self._size)
        up = setup.pixel_map(size_px).up
        self._shapes = {
            name: block.outline(OUTLINE_POINTS) / setup.metres_per_pixel * [1.0, up]
            for name, block in setup.blocks.items()
        }

    def draw(self, number: int, frame: Array, release: FollowedRelease | None) -> None:
        """Draw one frame and what is followed in it."""
        import cv2

        if number % self._stride:
            return
        picture = cv2.resize(frame, self._size, interpolation=cv2.INTER_AREA)
        picture = picture if picture.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
        if release is not None and release.last_seen(1):
            seen = release.last_seen(TRAIL_FRAMES)
            trail = np.array([s.pose[:2] for s in seen])
            self._line(picture, trail, TRAIL_BGR, False)
            last = release.sights[-1]
            shown = last if not last.reason else seen[-1]
            c, s = np.cos(shown.pose[2]), np.sin(shown.pose[2])
            corners = self._shapes[release.block] @ np.array([[c, s], [-s, c]]) + shown.pose[:2]
            self._line(picture, corners, LOST_BGR if last.reason else SEEN_BGR, True)
            text = f"{release.block} {last.reason or f'{100 * last.confidence:.0f} %'}"
            cv2.putText(
                picture, text, (10, 44), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA
            )
        cv2.putText(
            picture,
            f"frame {number}",
            (10, 22),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5,
            (255, 255, 255),
            1,
            cv2.LINE_AA,
        )
        self._writer.write(picture)

    def _line(self, picture: Array, points: Array, colour: tuple[int, int, int], closed: bool) -> None:
        import cv2

        if len(points) > 1:
            fine = np.round((points + 0.5) * self._scale * 16 - 8).astype(np.int32)
            cv2.polylines(picture, [fine], closed, colour, 1, cv2.LINE_AA, shift=4)

    def close(self) -> None:
        """Close the video; OSError if it is not whole."""
        self._writer.close()
