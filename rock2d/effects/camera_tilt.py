"""The image axes are turned against the vertical."""

from collections.abc import Sequence

import numpy as np

from rock2d.effects.changes import AIM_PARAMETERS, with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import TRACK_AGAIN, FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number, plain


def apply(world: World, values: Sequence[float]) -> World:
    """(x, y) recorded = c + R(tilt) ((x, y) - c), θ recorded = θ + tilt: R turns counter-clockwise, c is the
    point that the camera aims at."""
    return with_view(world, values[1:], tilt_rad=world.view.tilt_rad + values[0])


def remedy(fitted: FittedEffect) -> str:
    """Set `tilt_deg`, by which the tracker turns the picture back, or correct the record."""
    value, half = fitted.values["tilt_rad"], fitted.half["tilt_rad"]
    turn, width = np.rad2deg([value, half])
    way = "counter-clockwise" if value > 0 else "clockwise"
    x, y = fitted.world().view.axis_m
    turned = (
        f"turn every position by {plain(-turn, width)}° about ({plain(x)}, {plain(y)}) m, counter-clockwise "
        f"positive, and add {plain(-value, half)} to every `theta_rad`"
    )
    return (
        f"The picture is turned by {number(abs(turn), width)}° {way} against the vertical. Set `tilt_deg: "
        f"{plain(turn, width)}` in the set-up file (add it, if `tilt_deg` is not 0 there; where `up` is down, with the "
        f"other sign). {fitted.origin()} "
        f"{TRACK_AGAIN}{fitted.by_hand(turned, f'{turned}; turn the velocities, too')} Level the camera before the "
        "next film."
    )


EFFECT = Effect(
    name="camera_tilt",
    summary="the image axes are turned against the vertical: gravity seems to have a part along the image's x",
    source="rigid rotation of the image, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter("tilt_rad", "rad", 0.0, -0.15, 0.15, "rotation of the record, counter-clockwise"),
        *AIM_PARAMETERS,
    ),
    apply=apply,
    remedy=remedy,
)
