"""Columns of the row of numbers by which hidden causes reach the compiled motion; 0 has no effect."""

(
    DRAG,  # acceleration DRAG |v|^DRAG_POWER against the velocity, (m/s)^(1-DRAG_POWER)/s
    DRAG_POWER,
    VELOCITY_DECAY,  # rate, 1/s
    SPIN_DECAY,  # rate, 1/s
    LIFT,  # turning rate of the path over the spin, 1
    LIFT_ARM,  # radius in m at which the lift saturates: LIFT / (1 + spin LIFT_ARM / speed)
    WIND,  # acceleration along x between two heights, m/s²
    WIND_LOW,  # m
    WIND_HIGH,  # m
    UPDRAUGHT,  # acceleration upward between two x, m/s²
    UPDRAUGHT_LEFT,  # m
    UPDRAUGHT_RIGHT,  # m
    ATTRACTION,  # acceleration toward the ground, m/s²
    ATTRACTION_RANGE,  # distance from the surface up to which it acts, m
    DASHPOT,  # N s/m
    DEPTH_DASHPOT,  # dashpot over depth (Hunt and Crossley), N s/m²
    TENSION,  # N
    TENSION_FADES,  # 1: falls linearly with the rise
    TENSION_SPEED,  # leaving speed of its onset, m/s
    PLOUGHING,  # N s/m²
    PLOUGHING_SQUARE,  # N s²/m³
    SLIP_CHANGE,  # relative change of friction at high slip, 1
    SLIP_SPEED,  # m/s
    SLIP_HYPERBOLIC,  # 0 exponential, 1 hyperbolic
    RECOIL_MASS,  # kg; 0: the embankment stands still
    RECOIL_SPRING,  # 1/s²
    RECOIL_DASHPOT,  # 1/s
    RECOIL_FRICTION,  # deceleration by friction at the base, m/s²
    DAMPING_RATE,  # growth of contact forces with speed by causes, N s/m; it limits time steps
    SHED_SHARE,  # share of the mass that stays in the first indentation, 1
    STRIP_FACTOR,  # factor on the stiffness in soft strips of ground; 0: no strip
    STRIP_LEFT,  # where one begins, m
    STRIP_WIDTH,  # m
    STRIP_PERIOD,  # m
    SIDE_LOG_RATIO,  # log of the stiffness of the hard side over that of the soft one
    SIDE_ANGLE,  # direction of the soft side in the block, rad
    SHAKE_AMPLITUDE,  # amplitude of the vertical motion of the ground, m
    SHAKE_RATE,  # rad/s
    SHAKE_PHASE,  # rad
    SPIN_KICK,  # speed at lift-off gained over |spin| × radius, 1
    SPEED_LOSS,  # 1: impacts take a share of the horizontal speed
    FRICTION_FALL,  # friction is divided by 1 + FRICTION_FALL × normal speed at the start of the contact, s/m
    WAVE_LOG_FACTOR,  # largest log of the factor on the unloading stiffness, which changes with x as a sine
    WAVE_NUMBER,  # wave number of this sine, rad/m
    WAVE_PHASE,  # rad
    N_PARAMETERS,  # number of the columns
) = range(46)
