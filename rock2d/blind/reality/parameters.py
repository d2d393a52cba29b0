"""Columns of a release's row of numbers by which hidden effects reach the compiled motion; 0 is without effect."""

from __future__ import annotations

(
    DRAG,  # acceleration DRAG |v|^POWER against the velocity, (m/s)^(1-POWER)/s
    POWER,
    DAMP_V,  # rate of decay of the velocity, 1/s
    DAMP_W,  # and of the spin, 1/s
    LIFT,  # turning rate of the path over the spin, 1
    LIFT_ARM,  # radius in m at which the lift saturates: LIFT / (1 + spin LIFT_ARM / speed)
    PUSH,  # acceleration along x between two heights, m/s²
    PUSH_LOW,
    PUSH_HIGH,
    DRAUGHT,  # acceleration upward between two x, m/s²
    DRAUGHT_LEFT,
    DRAUGHT_RIGHT,
    PULL,  # acceleration toward the ground, m/s²
    PULL_RANGE,  # within this distance of its surface, m
    VISCOUS,  # N s/m
    HUNT,  # N s/m²
    TENSION,  # N
    TENSION_FADES,  # 1: falls linearly with the rise
    TENSION_SPEED,  # leaving speed of its onset, m/s
    PLOUGH,  # N s/m²
    PLOUGH_SQUARE,  # N s²/m³
    SLIP_CHANGE,  # relative change of friction at high slip, 1
    SLIP_SPEED,  # m/s
    SLIP_FORM,  # 0 exponential, 1 hyperbolic
    RECOIL_MASS,  # kg; 0: the embankment stands still
    RECOIL_SPRING,  # 1/s²
    RECOIL_DASHPOT,  # 1/s
    RECOIL_GRIP,  # deceleration by friction at the base, m/s²
    STIFFENING_RATE,  # growth of contact forces with speed by effects, N s/m: it limits steps
    SHEDS,  # share of the mass that stays in the first indentation, 1
    STRIP_FACTOR,  # factor on stiffness in strips of ground; 0: no strip
    STRIP_LEFT,  # where one begins, m
    STRIP_WIDTH,
    STRIP_PERIOD,
    SIDE,  # log of the stiffness of the hard side over that of the soft one
    SIDE_ANGLE,  # direction of the soft side in the block, rad
    SHAKE,  # amplitude of the ground's vertical motion, m
    SHAKE_RATE,  # rad/s
    SHAKE_PHASE,  # rad
    KICK,  # speed at lift-off gained over |spin| × radius, 1
    LEAVES,  # 1: `shares` of the horizontal speed are lost at lift-off
) = range(41)
N_DIALS = 41
