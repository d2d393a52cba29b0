"""The video of a report: film and simulations side by side, with a still picture and a description."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.replay import Releases
from rock2d.diagnosis.report import report_data
from rock2d.errors import InputError
from rock2d.graphics.clips import Clip
from rock2d.graphics.pages import data_uri, download
from rock2d.wording import length

VIDEO = "side_by_side.webm"
VIDEO_SIZE, VIDEO_FPS, VIDEO_S = (1120, 440), 20.0, 10.0  # px, frames/s, length without the pauses
HOLD_S = 0.8  # pause at the end of a scene


def video_section(
    result: Diagnosis, film: Releases, poses: dict[str, Array], labels: Mapping[str, str], improves: bool, folder: Path
) -> dict[str, Any]:
    """Template variables of the video; the video is written into `folder`."""
    from rock2d.graphics.video import render_video
    from rock2d.graphics.video_frames import VideoOptions

    scenes, titles = report_data.video_scenes(result, film, poses, improves)
    spans_s = [float(np.ptp(scene[0][0].t_s)) for scene in scenes]
    cross_section, blocks = result.experiment.cross_section, result.experiment.blocks
    pace = VIDEO_S / max(sum(spans_s), 1e-6)
    slow_motion = float(round(pace)) if pace >= 1 else 1.0 / round(1.0 / pace)
    view = report_data.scenes_view(scenes, cross_section, max(b.radius_m for b in blocks.values()))
    shown = [labels[m] for m in ("measured", *poses)]
    path = folder / VIDEO
    render_video(
        path, cross_section, blocks, scenes, shown,
        VideoOptions(fps_video=VIDEO_FPS, slow_motion=slow_motion, size_px=VIDEO_SIZE, view=view, titles=titles,
                     hold_s=HOLD_S),
    )  # fmt: skip
    motion = [
        (title, clip.label, *pose)
        for title, scene in zip(titles, scenes, strict=True)
        for panel in scene
        for clip in panel
        for pose in np.column_stack([clip.t_s, clip.x_m, clip.y_m, clip.theta_rad])
    ]
    first = scene_sentence(scenes[0], titles[0], shown)
    improved, typical = ("that the effect brings nearest to the film", "with the median distance to the base law")
    said = (
        f"{len(shown)} pictures side by side, {slow_motion:g} times slower than the film: {', '.join(shown)}. For "
        f"each block it is the release {improved if improves else typical}, simulated from its first measured flight "
        "to the end of the film with the mean soil. The grey block beside a simulated one is that of the film. "
    )
    return {
        "video": data_uri("video/webm", path.read_bytes()),
        "video_name": VIDEO,
        "still": still(path, spans_s[0] * slow_motion + 0.5 * HOLD_S),
        "still_alt": f"Still of the video at the end of its first scene. {first}",
        "video_text": said + " ".join(scene_sentence(s, t, shown) for s, t in zip(scenes, titles, strict=True)),
        "video_data": download("video.csv", ("scene", "series", "t_s", "x_m", "y_m", "theta_rad"), motion),
    }


def scene_sentence(scene: Sequence[Sequence[Clip]], title: str, labels: Sequence[str]) -> str:
    """A sentence on the final distances of the simulated blocks of a scene from the filmed one."""
    measured, *simulated = (panel[0] for panel in scene)
    parts = []
    for label, clip in zip(labels[1:], simulated, strict=True):
        distance_m = float(np.hypot(clip.x_m[-1] - measured.x_m[-1], clip.y_m[-1] - measured.y_m[-1]))
        model = label if label.startswith("with") else f"in the {label}"
        parts.append(f"{length(distance_m)} from the film {model}")
    return f"{title[0].upper()}{title[1:]}: the block ends {', '.join(parts)}."


def still(path: Path, at_s: float) -> str:
    """The picture of a video at an instant, or its last picture, as the data URI of a PNG. Raises InputError if the
    video cannot be read."""
    import cv2

    reader = cv2.VideoCapture(str(path))
    try:
        picture = None
        for _ in range(max(1, round(at_s * VIDEO_FPS))):
            found, frame = reader.read()
            if not found:
                break
            picture = frame
    finally:
        reader.release()
    if picture is None:
        raise InputError("the video that was written cannot be read", path, code="unreadable")
    return data_uri("image/png", cv2.imencode(".png", picture)[1].tobytes())
