"""The true frame rate differs from the stated one."""

from collections.abc import Sequence

from rock2d.effects.changes import with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import TRACK_AGAIN, FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number, plain


def apply(world: World, values: Sequence[float]) -> World:
    """t recorded = t true / time_scale."""
    return with_view(world, time_scale=world.view.time_scale * values[0])


def remedy(fitted: FittedEffect) -> str:
    """Set the true frame rate, the stated one over time_scale, or correct the record."""
    value, half = fitted.values["time_scale"], fitted.half["time_scale"]
    stated = fitted.fps
    true, width = stated / value, stated * half / value**2
    film = f"multiply every `t_s` by {plain(value, half)} and set `fps: {plain(true, width)}` in experiment.yaml"
    table = f"divide all velocities and spins by {plain(value, half)}"
    return (
        f"The film was taken with {number(true, width)} frames/s, not with {stated:g}. Set `fps: "
        f"{plain(true, width)}` in the set-up file. {TRACK_AGAIN}{fitted.by_hand(film, table)} Film a clock to check."
    )


EFFECT = Effect(
    name="frame_rate_error",
    summary="the true frame rate differs from the stated one: gravity goes with its square, contact times with it",
    source="the camera's clock, `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter("time_scale", "1", 1.0, 0.85, 1.15, "true duration over recorded one: stated over true rate"),
    ),
    apply=apply,
    remedy=remedy,
)
