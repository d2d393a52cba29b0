"""What makes costs comparable between machines, whose speeds differ by a factor of three: some fixed arithmetic."""

from time import perf_counter

import numba
import numpy as np

STEPS = 10_000_000


@numba.njit
def _swing(steps):
    """An oscillator, each step of which waits for the one before."""
    x, v = 1.0, 0.0
    for _ in range(steps):
        v -= 0.01 * x / np.sqrt(1.0 + v * v)
        x += 0.01 * v
    return x


def kernel_s() -> float:
    """Seconds that the calibration kernel takes on one thread; compiled before."""
    _swing(1)
    begin = perf_counter()
    _swing(STEPS)
    return perf_counter() - begin


def wait(what: str, seconds, beside, of: str = "kernel") -> dict[str, object]:
    """A line of the table of waits: the seconds of each round, and those of what they are compared with (`of`), taken
    in turns with them. The ratio is the median of the ratios of the rounds."""
    seconds = np.asarray(seconds, float)
    ratio = float(np.median(seconds / np.asarray(beside, float)))
    return {"what": what, "seconds": float(np.median(seconds)), "n": len(seconds), "ratio": ratio, "of": of}
