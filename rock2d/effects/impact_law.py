"""Effects that the impact law lacks: forces on the block in contact, and motion out of the plane."""

from collections.abc import Sequence

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.changes import with_column
from rock2d.effects.effect import STANDARD_GRAVITY_M_S2, Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World
from rock2d.wording import number


@kernel
def dashpot_force(c, h, depth, rate, peak, bottom, force_n):
    """F = (c + h δ) dδ/dt in N while the ground presses, c in N s/m, h in N s/m², from the first touch on. The
    total force is not negative."""
    return (c + h * depth) * rate if depth >= bottom else 0.0


def dashpot_damping(c, h):
    """Derivative of the force by the speed in N s/m, at a penetration of 10 mm."""
    return c + 0.01 * h


def with_viscous_damping(world: World, values: Sequence[float]) -> World:
    size = world.fitted_size_m
    mass = world.fitted_mass_kg
    world = with_column(world, "viscous_Ns_m", values[0] * mass)
    return with_column(world, "viscous_Ns_m2", values[1] * mass / size)


def viscous_damping_remedy(fitted: FittedEffect) -> str:
    """Compare light and heavy blocks, which the same dashpots brake less."""
    constant = fitted.values["rate_1_s"] * fitted.setup.fitted_mass_kg
    deep = fitted.values["deep_rate_1_s"] * fitted.setup.fitted_mass_kg / fitted.setup.mean_size_m
    return (
        "Drop a light and a heavy block of one shape vertically on the flat soil, from several heights: the lighter "
        "one should rebound less. If so, add a dashpot parallel to the normal spring: F = (c + h δ) dδ/dt with c = "
        f"{number(constant)} N s/m and h = {number(deep)} N s/m²."
    )


VISCOUS_DAMPING = Effect(
    name="viscous_damping",
    summary="rate-dependent normal force while the ground presses on the block",
    source="dashpot parallel to the spring: Cundall & Strack (1979), A discrete model for granular assemblies; one "
    "that grows with the depth: Hunt & Crossley (1975), Coefficient of restitution interpreted as damping in "
    "vibroimpact",
    phase="impact",
    origin="impact law",
    # critical is 2 √(k_l / m): 1,300 1/s for the paper's blocks, if they penetrate by a tenth of their size
    parameters=(
        Parameter("rate_1_s", "1/s", 0.0, 0.0, 900.0, "dashpot over the blocks' mean mass", time=-1),
        Parameter(
            "deep_rate_1_s",
            "1/s",
            0.0,
            0.0,
            9000.0,
            "growth of the dashpot down to a depth of one block size, over the mean mass",
            time=-1,
        ),
    ),
    apply=with_viscous_damping,
    remedy=viscous_damping_remedy,
    columns=("viscous_Ns_m", "viscous_Ns_m2"),
    normal=dashpot_force,
    damping=dashpot_damping,
)


ONSET_M_S = 0.02  # leaving speed up to which the pull grows: a sudden pull would make a block at rest vibrate
ONSET_SHARE = 0.1  # share of the path out of the indentation over which the pull grows


@kernel
def adhesion_force(pull, depth, rate, peak, bottom, force_n):
    """F = -pull in N on a block that leaves (dδ/dt < 0), from the bottom of the indentation, where the ground stops
    pressing, to the original surface. The pull grows linearly with the distance and with the leaving speed. A block
    that leaves faster than ONSET_M_S loses the energy pull × bottom × (1 - ONSET_SHARE / 2)."""
    if rate >= 0.0 or depth >= bottom or bottom <= 0.0:
        return 0.0
    return -pull * min(1.0, -rate / ONSET_M_S) * min(1.0, (bottom - depth) / (ONSET_SHARE * bottom))


def adhesion_damping(pull):
    """Largest derivative of the force by the speed in N s/m: at the onset."""
    return abs(pull) / ONSET_M_S


def with_adhesion(world: World, values: Sequence[float]) -> World:
    return with_column(world, "adhesion_N", values[0] * world.fitted_mass_kg * STANDARD_GRAVITY_M_S2)


def adhesion_remedy(fitted: FittedEffect) -> str:
    """Measure the pull in N."""
    pull = fitted.number("pull_per_weight", fitted.setup.fitted_mass_kg * STANDARD_GRAVITY_M_S2)
    return (
        "Press a block into the soil and lift it with a spring balance: in addition to its weight a pull of "
        f"{pull} N is expected. Dry the soil or clean the blocks and film again, or add "
        "the pull to the contact law while the block leaves."
    )


ADHESION = Effect(
    name="adhesion",
    summary="wet soil pulls on a leaving block until the block is clear of the ground",
    source="constant tension along the path out of the indentation, the simplest law with a work of separation",
    phase="impact",
    origin="impact law",
    # wet soil sucks with some kPa: 5 kPa are 6.5 weights of a 3 cm cube of rock if they act on one side, 20 on three
    parameters=(Parameter("pull_per_weight", "1", 0.0, 0.0, 20.0, "pull divided by the blocks' mean weight"),),
    apply=with_adhesion,
    remedy=adhesion_remedy,
    columns=("adhesion_N",),
    normal=adhesion_force,
    damping=adhesion_damping,
)


@kernel
def ploughing_force(c, depth, slip, force_n):
    """F = c δ u in N against the slip u of the contact point, c in N s/m², while the ground presses."""
    return c * depth * slip if force_n > 0.0 else 0.0


def ploughing_damping(c):
    """Derivative of the force by the speed in N s/m, at a penetration of 10 mm."""
    return 0.01 * c


def with_ploughing_drag(world: World, values: Sequence[float]) -> World:
    size = world.fitted_size_m
    return with_column(world, "ploughing_Ns_m2", values[0] * world.fitted_mass_kg / size)


def ploughing_drag_remedy(fitted: FittedEffect) -> str:
    """Measure the grooves, or add the drag to the contact law."""
    drag = fitted.values["rate_1_s"] * fitted.setup.fitted_mass_kg / fitted.setup.mean_size_m
    return (
        "Measure depth and length of the grooves: deep, fast ones should brake the block more than friction does. "
        f"Then add a tangential force F = c δ u against the slip u, with c = {number(drag)} N s/m² and the "
        "depth δ. Shallow throws at two speeds separate it from friction, which does not grow with the speed."
    )


PLOUGHING_DRAG = Effect(
    name="ploughing_drag",
    summary="the block ploughs: tangential resistance that grows with depth and speed",
    source="drag of the ploughed front, proportional to its area and to the speed",
    phase="impact",
    origin="impact law",
    parameters=(
        Parameter(
            "rate_1_s",
            "1/s",
            0.0,
            0.0,
            6000.0,
            "drag over slip, at a depth of one block size, over the mean mass",
            time=-1,
        ),
    ),
    apply=with_ploughing_drag,
    remedy=ploughing_drag_remedy,
    columns=("ploughing_Ns_m2",),
    tangential=ploughing_force,
    damping=ploughing_damping,
)


LEAST_RATIO = 0.05  # smallest tan φ (u) / tan φ (0)


@kernel
def friction_factor(change, speed, slip):
    """tan φ (u) / tan φ (0) = 1 + change (1 - exp(-|u| / speed)), u the slip in m/s."""
    return max(LEAST_RATIO, 1.0 + change * (1.0 - np.exp(-abs(slip) / speed)))


def with_slip_dependent_friction(world: World, values: Sequence[float]) -> World:
    change, speed = values
    if change == 0.0:
        return world
    return with_column(with_column(world, "friction_change", change), "friction_speed_m_s", speed)


def slip_dependent_friction_remedy(fitted: FittedEffect) -> str:
    """Measure the friction angle at low and at high speed."""
    change, speed = fitted.values["change"], fitted.values["speed_m_s"]
    rest = float(fitted.law["friction_angle_deg"])
    fast = np.rad2deg(np.arctan(np.tan(np.deg2rad(rest)) * max(LEAST_RATIO, 1.0 + change)))
    return (
        f"Drag a block over the soil at speeds well below and above {number(speed)} m/s: the friction angle "
        f"should {'grow' if change > 0 else 'fall'} from {number(rest)}° to {number(float(fast))}°. If it "
        "does, make the friction of the contact law depend on the sliding speed."
    )


SLIP_DEPENDENT_FRICTION = Effect(
    name="slip_dependent_friction",
    summary="friction changes with the sliding speed, from its value at rest to another one",
    source="exponential (Stribeck) law, Bo & Pavelescu (1982), The friction-speed relation",
    phase="impact",
    origin="impact law",
    parameters=(
        Parameter("change", "1", 0.0, -0.9, 2.0, "relative change of tan φ at high sliding speed"),
        Parameter(
            "speed_m_s",
            "m/s",
            1.0,
            0.2,
            5.0,
            "sliding speed at which most of the change has occurred",
            length=1,
            time=-1,
        ),
    ),
    apply=with_slip_dependent_friction,
    remedy=slip_dependent_friction_remedy,
    columns=("friction_change", "friction_speed_m_s"),
    friction=friction_factor,
)


@kernel
def departure_velocities(angle, vx, vy, omega):
    """Velocities in the plane after an impact that turns the horizontal velocity by `angle` rad about the vertical: v_x
    becomes v_x cos(angle). The rest of the energy leaves the plane."""
    return vx * np.cos(angle), vy, omega


def with_out_of_plane(world: World, values: Sequence[float]) -> World:
    return with_column(world, "out_of_plane_rad", values[0])


def out_of_plane_remedy(fitted: FittedEffect) -> str:
    """Film from above as well."""
    lost = 1 - np.cos(fitted.values["angle_rad"])
    return (
        "Film from above as well: the horizontal velocity should turn by about "
        f"{fitted.number('angle_rad', np.rad2deg(1))}° at an impact, which takes {number(100 * lost)} % of it out "
        "of the plane. Guide the blocks between two plates, use cylinders, or leave out releases that swerve."
    )


OUT_OF_PLANE = Effect(
    name="out_of_plane",
    summary="motion leaves the plane at impacts: the horizontal velocity turns away",
    source="lateral dispersion of rockfall, Azzoni & de Freitas (1995): 10 to 20° of the fall line",
    phase="impact",
    origin="impact law",
    parameters=(Parameter("angle_rad", "rad", 0.0, 0.0, 1.0, "turn of the horizontal velocity at each impact"),),
    apply=with_out_of_plane,
    remedy=out_of_plane_remedy,
    columns=("out_of_plane_rad",),
    departure=departure_velocities,
)


EFFECTS = (VISCOUS_DAMPING, ADHESION, PLOUGHING_DRAG, SLIP_DEPENDENT_FRICTION, OUT_OF_PLANE)
