"""Orientation of a round block from its marks: rings of its picture are rotated to match those of the first one."""

import numpy as np

from rock2d.arrays import Array

RING_SAMPLES = 256  # samples on a ring
RING_RADII = np.linspace(0.2, 0.85, 12)  # radii at which marks are sampled, over that of the block
REFERENCE_UPDATE = 0.05  # weight of each frame in the reference
SMALLEST_CORRELATION = 0.5  # least correlation with the reference at which marks are recognised
HIGHEST_HARMONIC = 40  # highest harmonic of the angle that is compared; finer ones are noise
SMALLEST_MARK_CONTRAST = 0.05  # standard deviation of the grey values over the contrast; below it no marks


def nearest_angle(angle: float, near: float, symmetry: float) -> float:
    """The angle nearest to `near` among those at which the block looks the same."""
    return near + (angle - near + 0.5 * symmetry) % symmetry - 0.5 * symmetry


class Marks:
    """Marks of one block during one release."""

    def __init__(self) -> None:
        self._reference: Array | None = None  # harmonics (rings, HIGHEST_HARMONIC) of the picture at angle 0

    def angle(self, frame: Array, counts: Array, centre_px: tuple[float, float], radius_px: float, near_rad: float,
              contrast: float) -> float | None:  # fmt: skip
        """Angle of a block in rad from u toward v, the one nearest to `near_rad`; None if the marks cannot be
        recognised.

        The angle of the first picture is `near_rad` by definition. Where `counts` (height, width) is 0 soil may hide
        the block."""
        rings, hidden = self._rings(frame, centre_px, radius_px), self._rings(counts, centre_px, radius_px)
        if rings is None or hidden is None:
            return None
        shown = hidden > 0.5
        mean = (rings * shown).sum(axis=1, keepdims=True) / np.maximum(shown.sum(axis=1, keepdims=True), 1)
        rings = (rings - mean) * shown
        if float(np.std(rings)) < SMALLEST_MARK_CONTRAST * contrast:
            return None
        waves = np.fft.rfft(rings, axis=1)[:, 1 : HIGHEST_HARMONIC + 1]
        order = np.arange(1, HIGHEST_HARMONIC + 1)
        if self._reference is None:
            self._reference = waves * np.exp(1j * order * near_rad)
            return near_rad
        together = (waves * np.conj(self._reference)).sum(axis=0)
        size = np.sqrt((np.abs(waves) ** 2).sum() * (np.abs(self._reference) ** 2).sum())
        # correlation as a function of the turn, on a fine grid, then the top of a parabola
        fine = np.zeros(8 * RING_SAMPLES // 2 + 1, complex)
        fine[1 : HIGHEST_HARMONIC + 1] = together
        match = np.fft.irfft(fine, 8 * RING_SAMPLES) * 8 * RING_SAMPLES / 2 / max(size, 1e-12)
        turns = np.arange(8 * RING_SAMPLES) * 2 * np.pi / (8 * RING_SAMPLES)
        away = np.abs((turns - near_rad + np.pi) % (2 * np.pi) - np.pi)
        best = int(np.argmax(match - 0.02 * away))
        left, top, right = match[best - 1], match[best], match[(best + 1) % len(match)]
        curvature = left - 2 * top + right
        shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
        if top < SMALLEST_CORRELATION:
            return None
        angle = nearest_angle(turns[best] + shift * (turns[1] - turns[0]), near_rad, 2 * np.pi)
        if shown.all():
            self._reference = (1 - REFERENCE_UPDATE) * self._reference + REFERENCE_UPDATE * waves * np.exp(
                1j * order * angle
            )
        return float(angle)

    def _rings(self, frame: Array, centre_px: tuple[float, float], radius_px: float) -> Array | None:
        """(rings, RING_SAMPLES) grey values, None where the block leaves the picture."""
        import cv2

        spoke = np.arange(RING_SAMPLES) * 2 * np.pi / RING_SAMPLES
        r = radius_px * RING_RADII[:, None]
        u = (centre_px[0] + r * np.cos(spoke)).astype(np.float32)
        v = (centre_px[1] + r * np.sin(spoke)).astype(np.float32)
        if u.min() < 0 or v.min() < 0 or u.max() > frame.shape[1] - 1 or v.max() > frame.shape[0] - 1:
            return None
        return np.asarray(cv2.remap(frame, u, v, cv2.INTER_LINEAR), float)
