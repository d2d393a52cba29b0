"""Metres per pixel are off."""

from collections.abc import Sequence

from rock2d.effects.changes import AIM_PARAMETERS, with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import TRACK_AGAIN, FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number, plain


def apply(world: World, values: Sequence[float]) -> World:
    """(x, y) recorded = c + scale ((x, y) - c), c the point that the camera aims at."""
    return with_view(world, values[1:], scale=world.view.scale * values[0])


def remedy(fitted: FittedEffect) -> str:
    """Correct the calibration length, or the record."""
    value, half = fitted.values["scale"], fitted.half["scale"]
    factor, width = 1.0 / value, half / value**2
    way = "long" if value > 1 else "short"
    x, y = fitted.world().view.axis_m
    scaled = f"multiply the distance of every position from ({plain(x)}, {plain(y)}) m by {plain(factor, width)}"
    return (
        f"The calibration length is stated {number(100 * abs(value - 1), 100 * half)} % too {way}: what is "
        f"stated as 1 m is {number(factor, width)} m. Multiply `metres_per_pixel`, `distance_m` or `square_m` "
        f"in the set-up file, whichever is given there, by {plain(factor, width)}. {fitted.origin()} "
        f"{TRACK_AGAIN}{fitted.by_hand(scaled, f'{scaled}, and the velocities by the same factor')} Measure the "
        "calibration length again, in the plane of motion: one nearer to the camera gives too short lengths."
    )


EFFECT = Effect(
    name="scale_error",
    summary="metres per pixel are wrong: all lengths, speeds and accelerations are too large or too small",
    source="similarity of the image, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(Parameter("scale", "1", 1.0, 0.85, 1.15, "recorded length over true length"), *AIM_PARAMETERS),
    apply=apply,
    remedy=remedy,
)
