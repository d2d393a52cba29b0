"""How a video is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rock2d.graphics.canvas import Limits


@dataclass(frozen=True)
class VideoOptions:
    """How a video is made.

    Attributes
    ----------
    fps_video : pictures per second when it is played
    slow_motion : a scene lasts this many times as long as its motion; below 1 it is faster than life
    size_px : width and height, even
    titles : title of each scene; the last one is also that of all later scenes
    view : x_min, x_max, y_min, y_max in m; without it the motion is in view
    trail : whether the paths of the centroids are drawn
    hold_s : time for which the last picture of a scene stays
    """

    fps_video: float = 25
    slow_motion: float = 10
    size_px: tuple[int, int] = (1280, 720)
    titles: Sequence[str] = ()
    view: Limits | None = None
    trail: bool = True
    hold_s: float = 1.0


DEFAULT_OPTIONS = VideoOptions()
