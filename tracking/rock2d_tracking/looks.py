"""The looks of a block, which `learning` finds: mix of colours with the best contrast, size, kind of fit, picture."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d_tracking.edges import EdgePoints, edge_points
from rock2d_tracking.outline import Outline

GREY_BGR = np.array([0.114, 0.587, 0.299])  # weights of the usual grey
COLOUR_GAIN = 1.5  # by which a colour must separate better than grey before it is used
COLOUR_PAIRS = np.array([[1.0, -1.0, 0.0], [1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
# the rim of a block around its place on an arc, and its number of sectors
RIM_RADII, RIM_SECTORS = (0.5, 0.85), 8
WEAK_QUANTILE = 0.15  # of the contrast of the sectors
TEMPLATE_RADII = 1.35  # half width of a learned picture
LEAST_MATCH = 0.6  # correlation with the learned picture
PICTURE_ERROR_PX = 0.1  # standard error of a place that correlation found, before frames are compared
SEARCH_RADII = 0.8  # around the expected place in which the learned picture is looked for

Kind = Literal["outline", "edge", "picture"]


class BlockFrame(NamedTuple):
    """A frame in which a block is on its arc: its number, its picture, the place (2,) of the block in px, and its
    displacement (2,) in px per usual frame interval."""

    number: int
    picture: Array
    place: Array
    pace: Array


@dataclass(frozen=True)
class ChannelMix:
    """Converts a frame to one value per pixel: unchanged, grey, or the mix of colours with the best contrast.

    Attributes
    ----------
    weights_bgr : weights of the colours; None for the usual grey"""

    weights_bgr: Array | None = None

    def __call__(self, frame: Array) -> Array:
        """(height, width) uint8."""
        import cv2

        if frame.ndim == 2:
            return frame
        if self.weights_bgr is None:
            return np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
        w = self.weights_bgr
        zero = 255.0 * float(-w[w < 0].sum())  # so that no value is negative
        return np.asarray(cv2.transform(frame, np.append(w, zero)[None].astype(np.float32)))


@dataclass(frozen=True)
class Looks:
    """How one block is recognised in a picture.

    Attributes
    ----------
    kind : fit of the whole outline with one grey value, of the edge, or by correlation with a learned picture
    outline : its outline in the visible size
    size, size_error : visible over stated size, and its standard error
    picture : learned difference from the background, float32; only of kind "picture"
    centre_px : (2,) from the middle of this picture to the centroid
    bias_px : standard error of a coordinate that all frames share: for an outline, its distance from the edge fit; for
        a picture, the error of its centre
    shutter : share of the frame interval in which the shutter is open"""

    kind: Kind
    outline: Outline
    size: float = 1.0
    size_error: float = np.inf
    picture: Array | None = None
    bias_px: float = 0.0
    centre_px: tuple[float, float] = (0.0, 0.0)
    shutter: float = 0.0

    @cached_property
    def edge(self) -> EdgePoints:
        """The points on its outline at which its edge is looked for."""
        return edge_points(self.outline)


def best_channel_mix(block_frames: list[BlockFrame], still: Array, radius_px: float) -> ChannelMix:
    """The mix of channels in which the weakest parts of the rim of blocks have the best contrast; `still`: the picture
    without a block."""
    if still.ndim == 2 or not block_frames:
        return ChannelMix()
    steps = np.concatenate([_rim_steps(frame, still, radius_px) for frame in block_frames])
    if not len(steps):
        return ChannelMix()
    tried = [np.median(steps, axis=0), *np.linalg.svd(steps, full_matrices=False)[2], *np.eye(3), *COLOUR_PAIRS]

    def stands_out(weights: Array) -> float:
        size = float(np.hypot.reduce(weights))
        return float(np.quantile(np.abs(steps @ weights), WEAK_QUANTILE)) / size if size > 0.0 else 0.0

    best = max(tried, key=stands_out)
    if stands_out(best) <= COLOUR_GAIN * stands_out(GREY_BGR):
        return ChannelMix()
    return ChannelMix(best / np.abs(best).sum())


def _rim_steps(frame: BlockFrame, still: Array, radius_px: float) -> Array:
    """(n, 3) mean change of colour in each sector of the rim of a block."""
    place = frame.place
    v, u = _ring(still.shape[:2], place, RIM_RADII[0] * radius_px, RIM_RADII[1] * radius_px)
    step = frame.picture[v, u].astype(float) - still[v, u]
    sector = (np.arctan2(v - place[1], u - place[0]) / (2 * np.pi) % 1.0 * RIM_SECTORS).astype(int)
    return np.array([step[sector == k].mean(axis=0) for k in np.unique(sector)]).reshape(-1, 3)


def _ring(shape: tuple[int, int], place: Array, inner_px: float, outer_px: float) -> tuple[Array, Array]:
    """Rows and columns of the pixels between two circles."""
    v0, v1 = (int(np.clip(place[1] + d, 0, shape[0])) for d in (-outer_px, outer_px + 1))
    u0, u1 = (int(np.clip(place[0] + d, 0, shape[1])) for d in (-outer_px, outer_px + 1))
    v, u = np.mgrid[v0:v1, u0:u1]
    away = np.hypot(u - place[0], v - place[1])
    within = (away <= outer_px) & (away >= inner_px)
    return v[within], u[within]


def learned_picture(block_frames: list[BlockFrame], still: Array, radius_px: float) -> Array | None:
    """Median difference from the background around a block (2 h + 1 pixels wide); None if no frame contains it."""
    import cv2

    half = int(np.ceil(TEMPLATE_RADII * radius_px)) + 1
    size = (2 * half + 1, 2 * half + 1)
    found = []
    for _, picture, (u, v), _ in block_frames:
        if not (half <= u < still.shape[1] - half - 1 and half <= v < still.shape[0] - half - 1):
            continue
        off = picture.astype(np.float32) - still
        found.append(cv2.getRectSubPix(off, size, (float(u), float(v))))
    return np.median(found, axis=0).astype(np.float32) if found else None


def matched(
    image: Array, background: Array, picture: Array, start: Array, reach_px: float
) -> tuple[Array, float] | None:
    """Place (2,) in the patch at which the difference from the background matches `picture` best, and the correlation;
    None if it leaves the patch."""
    import cv2

    half, off = picture.shape[0] // 2, image - background
    search = max(3, int(SEARCH_RADII * reach_px))
    off = cv2.copyMakeBorder(off, half, half, half, half, cv2.BORDER_CONSTANT, value=0)
    u, v = round(float(start[0])) + half, round(float(start[1])) + half
    top, left = max(v - half - search, 0), max(u - half - search, 0)
    part = off[top : v + half + search + 1, left : u + half + search + 1]
    if min(part.shape) < picture.shape[0] + 2:
        return None
    match = cv2.matchTemplate(part, picture, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(np.argmax(match)), match.shape)
    if not (0 < row < match.shape[0] - 1 and 0 < column < match.shape[1] - 1):
        return None
    best = float(match[row, column])
    du = _parabola_vertex(match[row, column - 1], best, match[row, column + 1])
    dv = _parabola_vertex(match[row - 1, column], best, match[row + 1, column])
    return np.array([left + column + du, top + row + dv], float), best


def _parabola_vertex(left: float, middle: float, right: float) -> float:
    """Place of the top of the parabola through three values."""
    bend = left - 2 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0 else 0.0
