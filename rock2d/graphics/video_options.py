"""The options of a video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rock2d.graphics.canvas import Limits


@dataclass(frozen=True)
class VideoOptions:
    """The options of a video.

    Attributes
    ----------
    fps_video : frame rate of the video, 1/s
    slow_motion : duration of a scene divided by the duration of its motion; below 1 the video is faster than real time
    size_px : width and height, even numbers
    titles : title of each scene; later scenes have the last title
    view : x_min, x_max, y_min, y_max in m; default: the region in which blocks move
    trail : whether the paths of the centroids are drawn
    hold_s : time for which the last picture of a scene is shown, s
    """

    fps_video: float = 25
    slow_motion: float = 10
    size_px: tuple[int, int] = (1280, 720)
    titles: Sequence[str] = ()
    view: Limits | None = None
    trail: bool = True
    hold_s: float = 1.0


DEFAULT_OPTIONS = VideoOptions()
