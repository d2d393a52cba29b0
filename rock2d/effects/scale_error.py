"""Metres per pixel are off, along x and y alike or, if the camera looks aslant, a little more along one of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.effects.changes import AIM_PARAMETERS, with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import TRACK_AGAIN, FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number, plain

# Half widths of its interval (about four standard errors) from which on different scales along x and y are corrected.
CLEAR_ASPECT = 2.0


def apply(world: World, values: Sequence[float]) -> World:
    """(x, y) recorded = c + scale (aspect (x - c_x), y - c_y), c the point that the camera aims at."""
    scale, aspect, *aim = values
    return with_view(world, aim, scale=world.view.scale * scale, aspect=world.view.aspect * aspect)


def remedy(fitted: FittedEffect) -> str:
    """Correct the calibration length, or the record; only the record if the scales along x and y differ."""
    uneven = abs(fitted.values["aspect"] - 1.0) > CLEAR_ASPECT * fitted.half.get("aspect", np.inf)
    if not uneven:
        fitted = replace(fitted, values={**fitted.values, "aspect": 1.0}, half={**fitted.half, "aspect": 0.0})
    x, y = (plain(place) for place in fitted.world().view.axis_m)
    (of_x, of_y), (width_x, width_y) = fitted.propagated(lambda world: 1.0 / world.view.scales)
    again = (
        "Measure the calibration length again, in the plane of motion: one nearer to the camera gives too short "
        "lengths."
    )
    if uneven:
        scaled = (
            f"Multiply the distance of every position from ({x}, {y}) m by {plain(of_x, width_x)} along x and by "
            f"{plain(of_y, width_y)} along y"
        )
        return (
            f"The scales along x and y differ by {_off(fitted, 'aspect')}: the camera does not look at the plane "
            "of motion at a right angle. No key of the set-up file corrects this. "
            f"{scaled}, and the velocities by the same factors. Turn the camera before the next film. {again}"
        )
    way = "long" if fitted.values["scale"] > 1 else "short"
    scaled = f"multiply the distance of every position from ({x}, {y}) m by {plain(of_y, width_y)}"
    return (
        f"The calibration length is stated {_off(fitted, 'scale')} too {way}: what is stated as 1 m is "
        f"{number(of_y, width_y)} m. Multiply `metres_per_pixel`, `distance_m` or `square_m` in the set-up file, "
        f"whichever is given there, by {plain(of_y, width_y)}. {fitted.origin()} "
        f"{TRACK_AGAIN}{fitted.by_hand(scaled, f'{scaled}, and the velocities by the same factor')} {again}"
    )


def _off(fitted: FittedEffect, name: str) -> str:
    """The deviation of a factor from 1."""
    return f"{number(100 * abs(fitted.values[name] - 1), 100 * fitted.half[name])} %"


# A camera that looks more than 14° aslant (cos 14° = 0.97) shows nearer parts clearly larger, which no aspect does.
EFFECT = Effect(
    name="scale_error",
    summary="metres per pixel are wrong: all lengths, speeds and accelerations are too large or too small",
    source="similarity of the image, with a foreshortened x, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter("scale", "1", 1.0, 0.85, 1.15, "recorded length along y over true length"),
        Parameter("aspect", "1", 1.0, 0.97, 1.03, "scale along x over the scale along y", optional=True),
        *AIM_PARAMETERS,
    ),
    apply=apply,
    remedy=remedy,
)
