"""Headless video of trajectories: blocks on the cross-section, slowed down, with clock and scale.

A `Clip` is one block's motion, simulated or measured. Clips shown together share one clock; several lists of
clips ("scenes") are shown one after another in one view. VP9 in WebM, which browsers play.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.errors import InputError
from rock2d.graphics.canvas import Limits, Viewport, exact_view, fitted_view, motion_limits
from rock2d.graphics.clips import Clip
from rock2d.graphics.palette import MEASURED_COLOUR, SIMULATED_COLOUR, block_colours
from rock2d.graphics.video_file import Progress, write_video
from rock2d.graphics.video_frames import Frames
from rock2d.graphics.video_options import DEFAULT_OPTIONS, VideoOptions
from rock2d.graphics.video_panel import Layout, Panel
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection


def render_video(
    path: str | Path,
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    series: Sequence[Clip] | Sequence[Sequence[Clip]],
    options: VideoOptions = DEFAULT_OPTIONS,
    progress: Progress | None = None,
) -> Path:
    """Film `series` (clips together, or a list of scenes one after another) and return the path of the file.

    A block whose samples end before the scene does is drawn hollow if it was filmed, and stays as it stopped if it was
    simulated. `progress(done, all)` is called after each picture.

    Written beside `path` and renamed when whole. Raises InputError if the suffix is neither .webm nor .mp4,
    nothing is to be shown, or a clip's block is unknown; ValueError on bad sizes.
    """
    scenes = _with_labels(_scenes(series), blocks)
    layout = Layout(options.size_px, 1)
    view = _common_view(cross_section, blocks, scenes, layout, options.view)
    frames = Frames(layout, options)
    for scene in scenes:
        frames.add([Panel(cross_section, blocks, scene, (), view, "", scene)], scene)
    return _write(path, frames, options, progress)


def side_by_side(
    path: str | Path,
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    measured: Sequence[Clip],
    simulated: Sequence[Clip],
    options: VideoOptions = DEFAULT_OPTIONS,
    progress: Progress | None = None,
) -> Path:
    """Two panels with one clock and one view; the measured blocks on the left appear as ghosts in the right panel.

    With one clip a side, the distance and the angle between the two are written under the right panel. File handling
    and errors as in `render_video`.
    """
    left = [replace(c, colour=c.colour or MEASURED_COLOUR) for c in measured]
    right = [replace(c, colour=c.colour or SIMULATED_COLOUR) for c in simulated]
    labels = ("measured", "simulated")
    return compare_video(path, cross_section, blocks, [(left, right)], labels, options, progress)


def compare_video(
    path: str | Path,
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    scenes: Sequence[Sequence[Sequence[Clip]]],
    labels: Sequence[str],
    options: VideoOptions = DEFAULT_OPTIONS,
    progress: Progress | None = None,
) -> Path:
    """Panels with one clock and one view, a panel for each of `labels`; the first panel's blocks appear as ghosts in
    the others. `scenes` follow one another; each holds the clips of every panel.

    Where every panel shows one clip, its distance and angle from the first panel's are written below it. File handling
    and errors as in `render_video`.
    """
    if not scenes or not all(len(scene) == len(labels) and all(scene) for scene in scenes):
        raise InputError("side by side needs at least one clip on each side")
    layout = Layout(options.size_px, len(labels))
    dressed = [[_with_labels([panel], blocks)[0] for panel in scene] for scene in scenes]
    together = [[clip for panel in scene for clip in panel] for scene in dressed]
    view = _common_view(cross_section, blocks, together, layout, options.view)
    frames = Frames(layout, options)
    for scene, clips in zip(dressed, together, strict=True):
        panels = [
            Panel(cross_section, blocks, own, scene[0] if k else (), view, label, clips)
            for k, (own, label) in enumerate(zip(scene, labels, strict=True))
        ]
        frames.add(panels, clips)
    return _write(path, frames, options, progress)


def panel_views(
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    series: Sequence[Clip] | Sequence[Sequence[Clip]],
    options: VideoOptions = DEFAULT_OPTIONS,
    panels: int = 1,
) -> list[tuple[int, int, Viewport]]:
    """Where a picture shows what: left and top pixel of each panel, and its `Viewport` relative to that corner."""
    layout = Layout(options.size_px, panels)
    view = _common_view(cross_section, blocks, _with_labels(_scenes(series), blocks), layout, options.view)
    return [(left, layout.top, view) for left in layout.lefts]


def _write(path: str | Path, frames: Frames, options: VideoOptions, progress: Progress | None) -> Path:
    return write_video(path, frames, len(frames), options.fps_video, options.size_px, progress)


def _scenes(series: Sequence[Clip] | Sequence[Sequence[Clip]]) -> list[list[Clip]]:
    items: list[Any] = list(series)
    scenes = [items] if items and isinstance(items[0], Clip) else [list(s) for s in items if len(s)]
    if not scenes:
        raise InputError("nothing to show: no clips")
    return scenes


def _with_labels(scenes: Iterable[Sequence[Clip]], blocks: Mapping[str, Block]) -> list[list[Clip]]:
    """Clips with the label and colour of their block where they have none of their own."""
    colours = block_colours(blocks)
    out = []
    for scene in scenes:
        for clip in scene:
            if clip.block not in blocks:
                raise InputError(f"a clip shows block {clip.block}, the blocks are {', '.join(blocks)}")
        out.append(
            [
                replace(c, label=c.label or c.block.replace("_", " "), colour=c.colour or colours[c.block])
                for c in scene
            ]
        )
    return out


def _common_view(
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    scenes: Sequence[Sequence[Clip]],
    layout: Layout,
    limits: Limits | None,
) -> Viewport:
    if limits is not None:
        return exact_view(limits, layout.panel_width, layout.panel_height)
    clips = [c for scene in scenes for c in scene]
    radius = max(blocks[c.block].radius_m for c in clips)
    x, y = (np.concatenate([getattr(c, key) for c in clips]) for key in ("x_m", "y_m"))
    return fitted_view(motion_limits(cross_section, x, y, radius), layout.panel_width, layout.panel_height)
