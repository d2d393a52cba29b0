"""An axis, or the sense of rotation, is recorded with the wrong sign."""

from collections.abc import Sequence

from rock2d.effects.changes import with_view
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World

MIRROR_NONE, MIRROR_X, MIRROR_Y, MIRROR_THETA = range(4)
COLUMNS = {MIRROR_X: ("x_m", "vx_m_s"), MIRROR_Y: ("y_m", "vy_m_s"), MIRROR_THETA: ("theta_rad", "omega_rad_s")}


def apply(world: World, values: Sequence[float]) -> World:
    """x, y or θ recorded = -x, -y or -θ. `values[0]` is a choice: 0 none, 1 x (about x = 0), 2 y (about y = 0), 3 θ."""
    mirror = list(world.view.mirror)
    axis = round(float(values[0]))
    if axis != MIRROR_NONE:
        mirror[axis - 1] *= -1.0
    return with_view(world, mirror=tuple(mirror))


def remedy(fitted: FittedEffect) -> str:
    """Change the sign of the column."""
    if round(fitted.values["axis"]) not in COLUMNS:
        return "No axis is mirrored: correct nothing."
    place, speed = COLUMNS[round(fitted.values["axis"])]
    column = (
        f"`{place}` and of every `{speed}` and `{speed.replace('_', '_after_', 1)}`"
        if fitted.impacts_only
        else f"`{place}`"
    )
    return (
        f"Change the sign of every {column} and diagnose again. Then look for the cause: y grows upward, x to the "
        "right, angles counter-clockwise. In the set-up file, `up` turns y and the angle together; in `rock2d "
        "import`, so does `--y`."
    )


EFFECT = Effect(
    name="mirrored_axis",
    summary="an axis, or the sense of rotation, is recorded with the wrong sign",
    source="handedness of the image axes (y down in most image formats), `rock2d.scene.world.View`",
    phase="all",
    origin="camera",
    parameters=(
        Parameter(
            "axis",
            "choice",
            float(MIRROR_NONE),
            float(MIRROR_NONE),
            float(MIRROR_THETA),
            "the axis whose sign is wrong (1 x, 2 y, 3 theta)",
            choices=(float(MIRROR_X), float(MIRROR_Y), float(MIRROR_THETA)),
            choice_names=("x", "y", "theta"),
        ),
    ),
    apply=apply,
    remedy=remedy,
)
