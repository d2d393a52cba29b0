"""Videos of trajectories: blocks on the cross-section in slow motion, with clock and scale. No display is needed.

A `Clip` is the simulated or measured motion of one block. The clips of a scene share one clock; scenes are shown one
after another in the same view."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rock2d.errors import InputError
from rock2d.graphics.canvas import Limits, Viewport, exact_view, fitted_view, motion_limits
from rock2d.graphics.clips import Clip
from rock2d.graphics.palette import block_colours
from rock2d.graphics.video_file import Progress, write_video
from rock2d.graphics.video_frames import Frames, Layout, Panel, VideoOptions
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.wording import spoken


def render_video(
    path: str | Path,
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    scenes: Sequence[Sequence[Sequence[Clip]]],
    labels: Sequence[str],
    options: VideoOptions,
    progress: Progress | None = None,
) -> Path:
    """Write a video of several panels with one clock and one view, a panel for each of `labels`. The other panels also
    show the blocks of the first panel, translucent. A scene holds the clips of every panel.

    With one clip in every panel, the distance and the angle from the clip of the first panel are written below the
    others. After the last sample of a clip, a measured block is drawn as an outline, and a simulated block stays where
    it is. `progress(done, all)` is called after each picture.

    The file is written completely or not at all. Raises InputError if the suffix is neither .webm nor .mp4, a panel has
    no clips, or the block of a clip is unknown; ValueError if a size, a rate or the view is invalid."""
    if not scenes or not all(len(scene) == len(labels) and all(scene) for scene in scenes):
        raise InputError("nothing to show: a panel has no clips")
    layout = Layout(options.size_px, len(labels))
    labelled = [[_with_labels(panel, blocks) for panel in scene] for scene in scenes]
    together = [[clip for panel in scene for clip in panel] for scene in labelled]
    view = _common_view(cross_section, blocks, together, layout, options.view)
    frames = Frames(layout, options)
    for scene, clips in zip(labelled, together, strict=True):
        panels = [
            Panel(cross_section, blocks, own, scene[0] if k else (), view, label, clips)
            for k, (own, label) in enumerate(zip(scene, labels, strict=True))
        ]
        frames.add(panels, clips)
    return write_video(path, frames, len(frames), options.fps_video, options.size_px, progress)


def _with_labels(clips: Sequence[Clip], blocks: Mapping[str, Block]) -> list[Clip]:
    """Clips, with the name and the colour of their block where they have no label or colour."""
    colours = block_colours(blocks)
    for clip in clips:
        if clip.block not in blocks:
            raise InputError(f"a clip shows block {clip.block}, the blocks are {', '.join(blocks)}")
    return [replace(c, label=c.label or spoken(c.block), colour=c.colour or colours[c.block]) for c in clips]


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
