"""When the frames of a film were taken, in units of the usual time between two frames."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


class Clock:
    """Instants of frames; without `instants` (n,) one frame follows the other at one rate."""

    def __init__(self, instants: Array | None = None) -> None:
        """`instants`: of each frame, increasing."""
        self._instants = instants

    def __call__(self, frame: float | Array) -> Array:
        """Instants of frames, or between two of them; before and after the film at the usual rate."""
        at = np.asarray(frame, float)
        if self._instants is None:
            return at
        last = len(self._instants) - 1
        beyond = np.minimum(at, 0.0) + np.maximum(at - last, 0.0)
        return np.asarray(np.interp(at, np.arange(last + 1), self._instants) + beyond)


EVEN = Clock()  # of a film of one rate
