"""Fit of a block to a frame: its position and angle, and whether the fit can be trusted."""

import numpy as np

from rock2d.arrays import Array
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import MAD_TO_SD
from rock2d_tracking.background import Background
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.edges import NO_SMEAR, EdgeFit, fit_edges
from rock2d_tracking.looks import LEAST_MATCH, PICTURE_ERROR_PX, Looks, matched
from rock2d_tracking.outline import (
    FIT_ANGLE,
    FIT_BLUR,
    FIT_GREY,
    FIT_U,
    FIT_V,
    SMALLEST_BLUR_PX,
    TUKEY_SIGMAS,
    Outline,
    Patch,
    fit_pose,
)
from rock2d_tracking.sights import Sight, lost_sight

FIT_ROUNDS = 25
START_ANGLE_STEP_RAD = np.deg2rad(22.5)
LARGEST_MISFIT = 0.2  # misfit of the edge in units of the contrast; a larger misfit is not this block
FAINTEST_CONTRAST_SIGMAS, FAINTEST_CONTRAST_GREY = 4.0, 3.0  # in noise and in grey levels
FAINTEST_CONTRAST_SHARE = 0.3  # share of the usual contrast; fainter objects are dust or afterimages
# standard error of a fit, in px or in radii if that is more; a frame with a larger one is lost
LARGEST_FIT_ERROR_PX, LARGEST_FIT_ERROR_RADII = 0.5, 0.1
LEAST_SMEAR_PX = 2.0  # displacement while the shutter is open; a shorter one is treated as blur
COVERED_RADII = 0.7  # radius of the disc within an outline that is compared with the background
WINDOW_MARGIN_PX = 6.0
# least confidence of a trusted frame, over the share of the outline with which a block is followed
TRUSTED_OVER_SEEN = 1.25
SURE_FIT = 0.9  # confidence above which no other start angles are tried
VEIL_PX = 2.0, 8.0  # least and largest distance from the outline at which it is measured
FEWEST_VEIL_PIXELS = 60
FAINTEST_VEIL = 0.25  # in noise of a pixel; a fainter veil stays
VEIL_ROUNDS = 4


class Fitter:
    """Fits blocks to frames; keeps grey value and contrast of the last fit for the next.

    Attributes
    ----------
    background : the picture without a block
    visible : (height, width) uint8, 0 where soil may hide a block
    least_seen : share of the outline that must be seen
    pace_px : (2,) approximate displacement of the block per frame
    grey, contrast : those of the block that was fitted last"""

    def __init__(self, background: Background, visible: Array, least_seen: float) -> None:
        self.background, self.visible, self.least_seen = background, visible, least_seen
        self.grey = self.contrast = 0.0
        self.pace_px = NO_SMEAR
        self._blur = 1.0
        self._usual_contrast = 0.0  # contrast of the blocks so far

    def forget_contrast(self) -> None:
        """Forget the usual contrast; the next block may have another one."""
        self._usual_contrast = 0.0

    def window(self, pose: Array, reaches: float, outline: Outline) -> tuple[int, int, int, int]:
        """First and last u, first and last v around a pose, within the picture."""
        half = reaches * outline.reach_px + WINDOW_MARGIN_PX
        height, width = self.background.grey.shape
        u, v = np.clip(pose[:2], -1e6, 1e6)
        return (
            int(np.clip(u - half, 0, width)), int(np.clip(u + half + 1, 0, width)),
            int(np.clip(v - half, 0, height)), int(np.clip(v + half + 1, 0, height)),
        )  # fmt: skip

    def _patch(self, frame: Array, pose: Array, reaches: float, outline: Outline) -> tuple[Patch, Array]:
        """The piece of a frame around a pose, and what a pose (3,) in it is less than in the frame."""
        u0, u1, v0, v1 = self.window(pose, reaches, outline)
        part = np.s_[v0:v1, u0:u1]
        patch = Patch(
            frame[part].astype(np.float32), self.background.grey[part], self.visible[part], self.background.noise
        )
        return patch, np.array([u0, v0, 0.0])

    def fit_any_angle(
        self,
        number: int,
        frame: Array,
        looks: Looks,
        place: Array,
        least: float | None = None,
        turns: Array | None = None,
    ) -> Sight:
        """The best fit at a place from several start angles (all if None); ends at the first SURE_FIT."""
        best: Sight | None = None
        for turn in start_angles(looks.outline) if turns is None else turns:
            sight = self.fit(number, frame, looks, np.array([*place, turn]), None, least)
            if best is None or sight.confidence > best.confidence:
                best = sight
            if best.confidence > SURE_FIT:
                break
        assert best is not None
        return best

    def edge_fit(self, frame: Array, looks: Looks, start: Array, *, free_size: bool = False) -> EdgeFit | None:
        """The fit of the edge from a start (3,) in the film's pixels; None if it fails."""
        patch, corner = self._patch(frame, start, 1.9, looks.outline)
        if min(patch.visible.shape) < looks.outline.reach_px:
            return None
        smear_px = looks.shutter * self.pace_px
        if np.hypot(*smear_px) < LEAST_SMEAR_PX:
            smear_px = NO_SMEAR
        found = fit_edges(
            patch, looks.edge, start - corner,
            symmetric=looks.outline.symmetry_rad == 0.0, free_size=free_size, smear_px=smear_px,
        )  # fmt: skip
        return None if found is None else found._replace(pose=found.pose + corner)

    def covered(self, frame: Array, looks: Looks, pose: Array) -> float:
        """Share of the inside of an outline at a pose that differs from the background; NaN outside the picture."""
        patch, corner = self._patch(frame, pose, 1.0, looks.outline)
        v, u = np.indices(patch.visible.shape)
        inside = np.hypot(u + corner[0] - pose[0], v + corner[1] - pose[1]) <= COVERED_RADII * looks.edge.inner_px
        if not inside.any():
            return float("nan")
        apart = np.abs(patch.image - patch.background)[inside]
        return float((apart > max(FAINTEST_CONTRAST_SIGMAS * self.background.noise, FAINTEST_CONTRAST_GREY)).mean())

    def fit(
        self, number: int, frame: Array, looks: Looks, start: Array, grey: float | None, least: float | None = None
    ) -> Sight:
        """The fit of the block from a start (3,), or the reason why it failed.

        grey : grey of the block, None if it is not known
        least : share of the outline that must be seen, if not the usual one"""
        if looks.kind == "edge":
            return self._fit_edge(number, frame, looks, start, least)
        if looks.kind == "picture":
            return self._fit_picture(number, frame, looks, start)
        return self._fit_outline(number, frame, looks.outline, start, grey, least)

    def _fit_edge(self, number: int, frame: Array, looks: Looks, start: Array, least: float | None) -> Sight:
        found = self.edge_fit(frame, looks, start)
        if found is None:
            return lost_sight(number, "no contrast")
        if found.seen < (least or self.least_seen):
            return lost_sight(number, "hidden")
        if max(found.error[:2]) > max(LARGEST_FIT_ERROR_PX, LARGEST_FIT_ERROR_RADII * looks.edge.inner_px):
            return lost_sight(number, "unsure")
        return Sight(number, found.pose, found.error, found.seen)

    def _fit_picture(self, number: int, frame: Array, looks: Looks, start: Array) -> Sight:
        assert looks.picture is not None
        patch, corner = self._patch(frame, start, 3.0, looks.outline)
        near = start[:2] - looks.centre_px - corner[:2]
        found = matched(patch.image, patch.background, looks.picture, near, looks.outline.reach_px)
        if found is None or found[1] < LEAST_MATCH:
            return lost_sight(number, "another picture")
        pose = np.array([*(found[0] + looks.centre_px + corner[:2]), start[2]])
        return Sight(number, pose, np.array([PICTURE_ERROR_PX, PICTURE_ERROR_PX, np.nan]), found[1])

    def _fit_outline(
        self, number: int, frame: Array, outline: Outline, start: Array, grey: float | None, least: float | None
    ) -> Sight:
        patch, corner = self._patch(frame, start, 1.2, outline)
        height, width = patch.visible.shape
        if min(width, height) < outline.reach_px:
            return lost_sight(number, "out of the picture")
        own = start - corner
        if grey is None:
            b, a, half = int(own[0]), int(own[1]), int(0.4 * outline.reach_px) + 1
            # median of a part that is larger than the marks
            part = np.s_[max(a - half, 0) : a + half + 1, max(b - half, 0) : b + half + 1]
            grey = float(np.median(patch.image[part]))
        p = np.array([*own, grey, max(self._blur, SMALLEST_BLUR_PX), 0.0, 0.0])
        p, error, seen, misfit = fit_pose(patch, outline.edges, outline.semi_axes_px, p, FIT_ROUNDS, False)
        veiled = with_veil(patch, outline, p[[FIT_U, FIT_V, FIT_ANGLE]])
        if veiled is not patch:
            p, error, seen, misfit = fit_pose(veiled, outline.edges, outline.semi_axes_px, p, FIT_ROUNDS, True)
        a, b = int(np.clip(p[FIT_V], 0, height - 1)), int(np.clip(p[FIT_U], 0, width - 1))
        contrast = abs(float(p[FIT_GREY]) - float(patch.background[a, b]))
        pose = p[[FIT_U, FIT_V, FIT_ANGLE]] + corner
        reason = ""
        if not np.isfinite(p).all() or not np.isfinite(error).all():
            reason = "no fit"
        elif contrast < max(
            FAINTEST_CONTRAST_SIGMAS * self.background.noise,
            FAINTEST_CONTRAST_GREY,
            FAINTEST_CONTRAST_SHARE * self._usual_contrast,
        ):
            reason = "no contrast"
        elif seen < (least or self.least_seen):
            reason = "hidden"
        elif misfit > LARGEST_MISFIT:
            reason = "another outline"
        elif max(error[0], error[1]) > LARGEST_FIT_ERROR_PX:
            reason = "unsure"
        if reason:
            return lost_sight(number, reason)
        self.grey, self.contrast = float(p[FIT_GREY]), contrast
        self._usual_contrast = (
            contrast if self._usual_contrast == 0.0 else 0.99 * self._usual_contrast + 0.01 * contrast
        )
        self._blur = 0.9 * self._blur + 0.1 * min(float(p[FIT_BLUR]), 4.0)
        return Sight(number, pose, error, float(seen * max(0.0, 1.0 - misfit)))


def with_veil(patch: Patch, outline: Outline, pose: Array) -> Patch:
    """A patch whose background contains the dust or shadow about an outline at a pose (3,): a smooth surface through
    what differs from the background beside the outline. The patch itself if there is none to be seen."""
    v, u = np.indices(patch.visible.shape)
    place = np.stack([u, v], axis=-1) - pose[:2]
    beside_px = outline.distance_px(place, pose[2])
    beside = (beside_px > VEIL_PX[0]) & (beside_px < VEIL_PX[1])
    if beside.sum() < FEWEST_VEIL_PIXELS:
        return patch
    x, y = np.moveaxis(place / outline.reach_px, -1, 0)
    surface = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    known, apart = surface[beside], (patch.image - patch.background)[beside]
    left = apart - np.median(apart)
    for _ in range(VEIL_ROUNDS):
        limit = TUKEY_SIGMAS * max(MAD_TO_SD * float(np.median(np.abs(left))), patch.noise)
        root = np.clip(1.0 - (left / limit) ** 2, 0.0, None)
        found = np.linalg.lstsq(known * root[:, None], apart * root, rcond=None)[0]
        left = apart - known @ found
    if np.median(np.abs(known @ found)) < FAINTEST_VEIL * patch.noise:
        return patch
    return patch._replace(background=patch.background + (surface @ found).astype(np.float32))


def start_angles(outline: Outline) -> Array:
    """Start angles, close enough together that a fit from one of them finds the orientation."""
    if outline.symmetry_rad == 0.0:
        return np.zeros(1)
    return np.arange(0.0, outline.symmetry_rad, START_ANGLE_STEP_RAD)


def above_ground(cross_section: CrossSection, camera: PixelMap, size_px: tuple[int, int]) -> Array:
    """(height, width) uint8, 1 above the surveyed ground."""
    v, u = np.mgrid[0 : size_px[1], 0 : size_px[0]]
    world = camera.to_world(np.stack([u, v], axis=-1))
    ground = cross_section.height_m(world[..., 0].ravel()).reshape(u.shape)
    return np.asarray(~(world[..., 1] <= ground), np.uint8)  # outside the cross-section nothing hides
