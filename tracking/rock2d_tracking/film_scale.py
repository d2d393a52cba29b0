"""Scale and frame rate of a film. If one is unknown, it is computed from the acceleration of a falling block.

An acceleration a in px per frame squared means g = a × (metres per pixel) × (frames per second)²."""

from __future__ import annotations

from typing import NamedTuple

from rock2d.kinematics.film_findings import with_error
from rock2d.kinematics.flight_gravity import Measured
from rock2d_tracking import FROM_GRAVITY

GRAVITY_M_S2 = 9.81
USUAL_RATES = (24, 25, 30, 50, 60, 100, 120, 200, 240, 480, 960, 1000)  # of cameras, frames per second
NEAR_ERRORS = 2.0  # largest distance from a usual frame rate in standard errors


class FilmScale(NamedTuple):
    """Scale and frame rate of the recording.

    Attributes
    ----------
    metres_per_pixel, fps : None for the one that is computed from gravity
    gravity_m_s2 : at the place of the film"""

    metres_per_pixel: float | None
    fps: float | None
    gravity_m_s2: float = GRAVITY_M_S2

    @property
    def g_px_frame2(self) -> float:
        """Acceleration of gravity in px per frame squared; 0 if it is not known."""
        if self.metres_per_pixel is None or self.fps is None:
            return 0.0
        return self.gravity_m_s2 / self.metres_per_pixel / self.fps**2

    def completed(self, g_px_frame2: float) -> FilmScale:
        """The same with the unknown one computed from the acceleration of a block in px per frame squared."""
        if self.metres_per_pixel is not None and self.fps is None:
            return self._replace(fps=(self.gravity_m_s2 / self.metres_per_pixel / g_px_frame2) ** 0.5)
        if self.metres_per_pixel is None and self.fps is not None:
            return self._replace(metres_per_pixel=self.gravity_m_s2 / g_px_frame2 / self.fps**2)
        return self


UNKNOWN_SCALE = FilmScale(None, None)


class Proposal(NamedTuple):
    """The frame rate that gravity gives with the stated scale, and the scale with the stated frame rate."""

    fps: Measured
    metres_per_pixel: Measured

    @property
    def usual_fps(self) -> int | None:
        """The usual frame rate of cameras that agrees with `fps`, if there is exactly one."""
        near = [rate for rate in USUAL_RATES if abs(rate - self.fps.value) <= NEAR_ERRORS * self.fps.error]
        return near[0] if len(near) == 1 else None

    def sentence(self, *, options: bool) -> str:
        """For the user; `options`: whether scale and frame rate are options of the command, not keys of a file."""
        if options:
            rate, scale, word = "--fps", "--metres-per-pixel", f"--fps {FROM_GRAVITY}"
        else:
            rate, scale, word = "fps:", "scale: metres_per_pixel:", f"fps: {FROM_GRAVITY}"
        usual = self.usual_fps
        near = f"; the usual rate {usual} lies within {NEAR_ERRORS:g} standard errors" if usual is not None else ""
        fps, metres = self.fps, self.metres_per_pixel
        size = f"{metres.value:.4g} ± {metres.error:.1g}"
        return (
            f"which of the two do you know? If the scale: the film was taken with {with_error(fps)} frames/s{near}; "
            f"give `{rate} {usual or round(fps.value, 2):g}`, or `{word}` to take it as found. If the frame rate: a "
            f"pixel is {size} m; give `{scale} {metres.value:.4g}`"
        )


def proposal(scale: FilmScale, ratio: Measured) -> Proposal:
    """The proposal for a film with a stated `scale`; `ratio`: acceleration of blocks over gravity."""
    assert scale.fps is not None and scale.metres_per_pixel is not None
    share = ratio.error / ratio.value
    fps, metres = scale.fps / ratio.value**0.5, scale.metres_per_pixel / ratio.value
    return Proposal(Measured(fps, 0.5 * share * fps), Measured(metres, share * metres))
