"""The instants of the frames of a film, in units of the usual frame interval."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


class Clock:
    """Instants of frames; without `instants` the frame rate is constant."""

    def __init__(self, instants: Array | None = None) -> None:
        """`instants` (n,): of each frame, increasing."""
        self._instants = instants

    def __call__(self, frame: float | Array) -> Array:
        """Instants of frame numbers, interpolated between frames and extrapolated at the usual rate."""
        at = np.asarray(frame, float)
        if self._instants is None:
            return at
        last = len(self._instants) - 1
        beyond = np.minimum(at, 0.0) + np.maximum(at - last, 0.0)
        return np.asarray(np.interp(at, np.arange(last + 1), self._instants) + beyond)


EVEN = Clock()  # constant frame rate
