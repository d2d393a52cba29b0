"""The film with the tracked outlines drawn into it."""

from pathlib import Path

import numpy as np

from rock2d.arrays import Array
from rock2d.graphics.video_file import VideoWriter
from rock2d_tracking.setup_file import Setup
from rock2d_tracking.sights import FollowedRelease

OVERLAY_WIDTH_PX = 560
SEEN_BGR, LOST_BGR, TRAIL_BGR = (60, 200, 60), (40, 40, 230), (230, 160, 0)
OVERLAY_FRAMES = 500  # about the most pictures; of a longer film every second, third ... is drawn
OVERLAY_FPS = 25.0
TRAIL_FRAMES = 300  # length of the trail behind a block
OUTLINE_POINTS = 48


class Overlay:
    """Writes a WebM frame by frame, until `close`."""

    def __init__(self, path: Path, setup: Setup, size_px: tuple[int, int], expected_frames: int) -> None:
        self._scale, self._size = reduced_size(size_px, OVERLAY_WIDTH_PX)
        self._stride = max(1, -(-expected_frames // OVERLAY_FRAMES))
        self._writer = VideoWriter(path, OVERLAY_FPS, self._size)
        up = setup.pixel_map(size_px).up
        self._shapes = {
            name: block.outline(OUTLINE_POINTS) / setup.metres_per_pixel * [1.0, up]
            for name, block in setup.blocks.items()
        }

    def draw(self, number: int, frame: Array, release: FollowedRelease | None) -> None:
        """Draw one frame and what is followed in it."""
        if number % self._stride:
            return
        picture = reduced(frame, self._size)
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
            put_text(picture, text, (10, 44), 0.5)
        put_text(picture, f"frame {number}", (10, 22), 0.5)
        self._writer.write(picture)

    def _line(self, picture: Array, points: Array, colour: tuple[int, int, int], closed: bool) -> None:
        import cv2

        if len(points) > 1:
            fine = np.round((points + 0.5) * self._scale * 16 - 8).astype(np.int32)
            cv2.polylines(picture, [fine], closed, colour, 1, cv2.LINE_AA, shift=4)

    def close(self) -> None:
        """Close the video; OSError if it is not whole."""
        self._writer.close()


def reduced_size(size_px: tuple[int, int], width_px: int) -> tuple[float, tuple[int, int]]:
    """Scale and size of pictures that are at most `width_px` wide, even for a video."""
    scale = min(1.0, width_px / size_px[0])
    return scale, (int(size_px[0] * scale) // 2 * 2, int(size_px[1] * scale) // 2 * 2)


def reduced(frame: Array, size_px: tuple[int, int]) -> Array:
    """(height, width, 3) uint8."""
    import cv2

    picture = np.asarray(cv2.resize(frame, size_px, interpolation=cv2.INTER_AREA))
    return picture if picture.ndim == 3 else np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))


def put_text(picture: Array, text: str, at: tuple[int, int], scale: float) -> None:
    """Write white text into a picture; `at`: its lower left corner."""
    import cv2

    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
