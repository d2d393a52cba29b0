"""The filmed scene: ground, light and block, drawn anti-aliased: the share of the block in a pixel is the covered share
of its area."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.files.experiment import Experiment
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.synthetic.faults import HEAP_CORNERS, Faults, heap_m, shadow

Pose = tuple[float, float, float]
PixelBox = tuple[int, int, int, int]  # left, top, right, bottom; the last two exclusive
Window = tuple[slice, slice]

SMOOTH_CORNERS = 512  # corners of the polygon for a smooth profile
SUPERSAMPLING = 3  # parts of the side of a pixel
SMALLEST_COVER = 0.01  # a block that covers a smaller share of every pixel is out of the picture
SURFACE_STEP_PX = 3.0  # distance of the corners of the drawn surface
MARK_DOTS = ((0.42, 0.42, 0.17), (-0.45, 0.36, 0.11), (-0.12, -0.5, 0.14))  # x, y, radius of marks, in radii
MARK_LINE = np.array([[-0.85, -0.05], [0.85, -0.05], [0.85, 0.05], [-0.85, 0.05]])


@dataclass(frozen=True)
class Look:
    """Light and colours of the scene.

    Attributes
    ----------
    block_grey, mark_grey, soil_grey, background_grey : grey levels, 0 to 255
    texture_grey : 1 sigma of the soil's grains
    grain_px : distance from one of the soil's grains to the next
    rough_px : 1 sigma of the roughness of the soil's surface
    gradient_grey : difference of the background between opposite corners
    blur_px : 1 sigma of the lens' point spread
    marked : shapes of blocks that carry marks: a line and three dots"""

    block_grey: float = 215.0
    mark_grey: float = 40.0
    soil_grey: float = 118.0
    background_grey: float = 62.0
    texture_grey: float = 17.0
    grain_px: float = 3.0
    rough_px: float = 0.5
    gradient_grey: float = 14.0
    blur_px: float = 0.7
    marked: tuple[str, ...] = ("circle",)


PLAIN_LOOK = Look()


class Scene:
    """The fixed parts, drawn once, and the block drawn over them; light in grey levels, not rounded."""

    def __init__(
        self,
        experiment: Experiment,
        pixel_map: PixelMap,
        size_px: tuple[int, int],
        look: Look,
        faults: Faults,
        rng: np.random.Generator,
    ) -> None:
        self.cross_section, self.pixel_map = experiment.cross_section, pixel_map
        self.size_px, self.faults = size_px, faults
        self._outlines_m = {name: _outlines_m(block, look) for name, block in experiment.blocks.items()}
        greys = np.array([look.block_grey, look.mark_grey])
        greys -= faults.low_contrast * (greys - look.background_grey)
        self._block_grey, self._mark_grey = greys.tolist()
        r, radius = int(np.ceil(faults.defocus_px)), faults.defocus_px
        disc = coverage([_ellipse(radius, radius)], (-r, -r, r + 1, r + 1))
        self._blur_px, self._disc = look.blur_px, disc / max(disc.sum(), 1e-9)
        self._reach_px = int(np.ceil(4 * look.blur_px)) + r
        width, height = size_px
        ramp = np.linspace(0.25, -0.25, width) + np.linspace(0.25, -0.25, height)[:, None]
        background = np.clip(look.background_grey + look.gradient_grey * ramp, 0.0, 255.0)
        self._soil, self._ground = _soil(look, size_px, rng), np.zeros((height, width))
        for part_px in _ground_px(experiment.cross_section, pixel_map, size_px):
            rough_px = part_px + rng.normal(0.0, look.rough_px, part_px.shape)
            self._ground = np.minimum(self._ground + coverage([rough_px], (0, 0, width, height)), 1.0)
        self._rough_px = np.outer(rng.normal(0.0, look.rough_px, HEAP_CORNERS), [0.0, 1.0])
        still = background + self._ground * (self._soil - background)
        self.still, self._soil, self._ground = map(self._through_lens, (still, self._soil, self._ground))

    def light(self, block: Block, poses_m: Array) -> tuple[Array, bool]:
        """(height, width) float32 of a block at `poses_m` (n, 3) during the exposure, and its visibility."""
        silhouette_m, *marks_m = self._outlines_m[block.name]
        silhouettes = [self._placed(silhouette_m, pose) for pose in poses_m]
        marks = [self._placed(mark, pose) for pose in poses_m for mark in marks_m]
        light, pose = self.still.copy(), poses_m[len(poses_m) // 2]
        shade = shadow(self.cross_section, block, pose, self.pixel_map, self.faults.shadow)
        at, cover = self._cover(silhouettes)
        if cover.max(initial=0.0) < SMALLEST_COVER:
            return light, False
        dark = self._window(shade.corners_px)
        light[dark] -= self._ground[dark] * self._soil[dark] * shade.taken(dark)
        light[at] += cover / len(poses_m) * (self._block_grey - light[at])
        if marks:
            at, cover = self._cover(marks)
            light[at] += cover / len(poses_m) * (self._mark_grey - self._block_grey)
        heap = heap_m(self.cross_section, block, pose, self.faults.burial_radii)
        if heap is not None:
            at, cover = self._cover([self.pixel_map.to_pixel(heap) + self._rough_px])
            light[at] += cover * (self._soil[at] * (1.0 - shade.taken(at)) - light[at])
        return light, True

    def _placed(self, outline_m: Array, pose_m: Array) -> Array:
        """An outline in body axes as pixels."""
        c, s = np.cos(pose_m[2]), np.sin(pose_m[2])
        return self.pixel_map.to_pixel(outline_m @ np.array([[c, s], [-s, c]]) + pose_m[:2])

    def _cover(self, outlines_px: Sequence[Array]) -> tuple[Window, Array]:
        """Share of the light from within outlines, blurred by the lens, and the window in the image.

        The blur of the lens is computed on a finer grid, because it acts before the pixels sample the image."""
        points, reach = np.concatenate(outlines_px), self._reach_px
        beyond = np.array(self.size_px) + reach
        low = np.clip(np.floor(points.min(axis=0) + 0.5) - reach, -reach, beyond - 1).astype(int)
        high = np.clip(np.ceil(points.max(axis=0) + 0.5) + reach, low + 1, beyond).astype(int)
        (left, top), (right, bottom) = (SUPERSAMPLING * low).tolist(), (SUPERSAMPLING * high).tolist()
        fine = coverage([SUPERSAMPLING * (outline + 0.5) - 0.5 for outline in outlines_px], (left, top, right, bottom))
        (left, top), (right, bottom) = (np.clip(corner, 0, self.size_px) for corner in (low, high))
        inside = np.s_[top - low[1] : bottom - low[1], left - low[0] : right - low[0]]
        return np.s_[top:bottom, left:right], self._through_lens(fine, SUPERSAMPLING)[inside]

    def _window(self, points_px: Array) -> Window:
        """The part of the image around points."""
        extremes = np.rint([points_px.min(axis=0), points_px.max(axis=0)])
        (left, top), (right, bottom) = np.clip(extremes, 0, self.size_px).astype(int)
        return np.s_[top:bottom, left:right]

    def _through_lens(self, light: Array, fine: int = 1) -> Array:
        """Light on pixels, blurred by the lens; the pixels of `light` are `fine` times finer."""
        import cv2

        seen: Array = light.astype(np.float32)
        if self._blur_px:
            sigma = fine * self._blur_px
            width = 2 * int(np.ceil(4 * sigma)) + 1
            seen = cv2.GaussianBlur(seen, (width, width), sigma, borderType=cv2.BORDER_REPLICATE)
        if fine > 1:
            seen = cv2.resize(seen, None, fx=1 / fine, fy=1 / fine, interpolation=cv2.INTER_AREA)
        if self.faults.defocus_px:
            seen = cv2.filter2D(seen, -1, self._disc, borderType=cv2.BORDER_REPLICATE)
        return seen


def coverage(outlines_px: Sequence[Array], box: PixelBox) -> Array:
    """Share of each pixel of `box` that closed outlines (n, 2) cover, (height, width); where they overlap, the sum.

    Exact: the outlines are split at the borders of the pixels; each piece adds the area to its right to its pixel, and
    its height to all pixels beyond. All outlines must have the same orientation."""
    left, top, right, bottom = box
    width, height = right - left, bottom - top
    if not outlines_px:
        return np.zeros((height, width))
    corner = np.array([left - 0.5, top - 0.5])  # the coordinates of a pixel are those of its centre
    start = np.concatenate(list(outlines_px)) - corner
    end = np.concatenate([np.roll(outline, -1, axis=0) for outline in outlines_px]) - corner
    for axis in (0, 1):
        start, end = _split_at_pixels(start, end, axis)
    x, y = (0.5 * (start + end)).T
    inside = (y > 0) & (y < height)
    x, row, rise = np.clip(x[inside], 0, width), y[inside].astype(int), (end - start)[inside, 1]
    column = x.astype(int)
    cell, cells = row * (width + 2) + column, height * (width + 2)
    beyond = rise * (x - column)
    area = np.bincount(cell, rise - beyond, cells) + np.bincount(cell + 1, beyond, cells)
    return np.abs(np.cumsum(area.reshape(height, width + 2), axis=1)[:, :width])


def _split_at_pixels(start: Array, end: Array, axis: int) -> tuple[Array, Array]:
    """Edges, split wherever their coordinate `axis` is a whole number."""
    a, b = start[:, axis], end[:, axis]
    first = np.floor(np.minimum(a, b)).astype(int) + 1
    count = np.maximum(np.ceil(np.maximum(a, b)).astype(int) - first, 0)
    edge, total = np.repeat(np.arange(len(a)), count), np.cumsum(count)
    level = first[edge] + np.arange(len(edge)) - (total - count)[edge]
    share = (level - a[edge]) / (b - a)[edge]
    points = start[edge] + share[:, None] * (end - start)[edge]
    points[:, axis] = level
    points = points[np.lexsort((share, edge))]
    return np.insert(points, total - count, start, axis=0), np.insert(points, total, end, axis=0)


def _ellipse(a: float, b: float, corners: int = SMOOTH_CORNERS) -> Array:
    """(corners, 2) polygon of an ellipse's area."""
    angle = np.linspace(0.0, 2 * np.pi, corners, endpoint=False)
    out = np.sqrt(2 * np.pi / corners / np.sin(2 * np.pi / corners))
    return out * np.column_stack([a * np.cos(angle), b * np.sin(angle)])


def _outlines_m(block: Block, look: Look) -> list[Array]:
    """Silhouette and marks in body axes, in m."""
    if block.smooth:
        silhouette, inner = _ellipse(*block.semi_axes_m), min(block.semi_axes_m)
    else:
        import shapely

        profile = shapely.Polygon(block.corners_m)
        inner = profile.exterior.distance(shapely.Point(0.0, 0.0))
        if block.rounding_m:
            radius = min(block.rounding_m, (1 - 1e-6) * block.largest_rounding_m)  # the inset must not vanish
            profile = profile.buffer(-radius, join_style="mitre").buffer(radius, quad_segs=32)
        # a lens that distorts bends the faces
        silhouette = np.array(shapely.segmentize(profile, block.radius_m / 16).exterior.coords[:-1])
    if block.shape not in look.marked:
        return [silhouette]
    return [silhouette, inner * MARK_LINE, *[inner * (_ellipse(r, r, 32) + np.array([x, y])) for x, y, r in MARK_DOTS]]


def _ground_px(cross_section: CrossSection, pixel_map: PixelMap, size_px: tuple[int, int]) -> list[Array]:
    """Outlines of the soil in the picture, a corner every few pixels; horizontal beyond the cross-section."""
    import shapely

    grid_px = np.stack(np.meshgrid(*(np.linspace(-8.0, size + 7.0, 33) for size in size_px)), axis=-1)
    view_m = pixel_map.to_world(grid_px.reshape(-1, 2))
    low, high = view_m.min(axis=0), view_m.max(axis=0)
    points = cross_section.points_m
    left, deep = np.minimum(low, points.min(axis=0)) - 1.0
    right = max(high[0], points[:, 0].max()) + 1.0
    ends = [[right, points[-1, 1]], [right, deep], [left, deep], [left, points[0, 1]]]
    soil = shapely.make_valid(shapely.Polygon([*points, *ends])).intersection(shapely.box(*low, *high))
    parts = shapely.get_parts(shapely.segmentize(soil, SURFACE_STEP_PX * pixel_map.metres_per_pixel))
    outlines = [part.exterior.coords[:-1] for part in parts if part.area > 0.0]
    return [pixel_map.to_pixel(np.array(outline)) for outline in outlines]


def _soil(look: Look, size_px: tuple[int, int], rng: np.random.Generator) -> Array:
    """(height, width) grey levels: grains of different grey, darker at the rim, and damp patches."""
    import cv2

    shape = size_px[::-1]
    middles = (rng.random(shape) > look.grain_px**-2.0).astype(np.uint8)
    away, grain = cv2.distanceTransformWithLabels(middles, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)
    grains = rng.standard_normal(int(grain.max()) + 1)[grain] - 1.5 * away / look.grain_px
    patches = cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), 8 * look.grain_px)
    field = grains / grains.std() + 0.4 * patches / patches.std()
    return np.clip(look.soil_grey + look.texture_grey * (field - field.mean()), 0.0, 255.0)
