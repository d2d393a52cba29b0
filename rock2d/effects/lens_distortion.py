"""Radial distortion of the image, about the point that the camera aims at: see `changes.aim_and_width`."""

from collections.abc import Sequence

from rock2d.effects.changes import AIM_PARAMETERS, aim_and_width, with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import TRACK_AGAIN, FittedEffect
from rock2d.scene.world import World
from rock2d.wording import plain


def apply(world: World, values: Sequence[float]) -> World:
    """d recorded = d (1 + k |d|²) with d = (x, y) - c, k = edge / W²: c is the point that the camera aims at, W the
    width of embankment and ditch."""
    return with_view(
        world, values[1:], lens_per_m2=world.view.lens_per_m2 + values[0] / aim_and_width(world.cross_section)[1] ** 2
    )


def remedy(fitted: FittedEffect) -> str:
    """Set `distortion` in the set-up file, where k refers to half the picture's diagonal instead of W."""
    value, half = fitted.values["edge"], fitted.half["edge"]
    view = fitted.world().view
    per_m2 = view.lens_per_m2
    width = abs(per_m2 / value) * half if value else 0.0
    way = "outward" if value > 0 else "inward"
    x, y = view.axis_m
    return (
        f"The lens moves points {way}. Set `distortion: {{k: K}}` in the set-up file with K = "
        f"{plain(per_m2, width or None)} × D², where D is half the picture's diagonal in m; `centre_px` is the pixel "
        f"that shows ({plain(x)}, {plain(y)}) m. {TRACK_AGAIN} Better: film a checkerboard at the edge of the picture "
        "and measure k."
    )


EFFECT = Effect(
    name="lens_distortion",
    summary="radial distortion of the image: points away from its middle are recorded too far out or in",
    source="first term of D. C. Brown (1971), Close-range camera calibration: r (1 + k r²), `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter(
            "edge",
            "1",
            0.0,
            -0.05,
            0.05,
            "k W²: displacement over distance at the width W of embankment and ditch from the image's middle",
        ),
        *AIM_PARAMETERS,
    ),
    apply=apply,
    remedy=remedy,
)
