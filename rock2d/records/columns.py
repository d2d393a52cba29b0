"""The columns of all arrays and tables with results of a release.

Compiled code uses the integers as indices; tables use the names. SI units, as the names say."""

# a state of the centre of mass
STATE_NAMES = ("x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "omega_rad_s")
X, Y, THETA, VX, VY, OMEGA = range(len(STATE_NAMES))
N_STATE = len(STATE_NAMES)
N_POSE = THETA + 1  # x, y, theta: the first columns of a state
POSITION, POSE = slice(X, THETA), slice(X, VX)
POSE_NAMES = STATE_NAMES[POSE]
LINEAR_VELOCITY, RATES = slice(VX, OMEGA), slice(VX, OMEGA + 1)


def after(name: str) -> str:
    """Name of the column of a quantity after an impact: "vx_m_s" becomes "vx_after_m_s"."""
    stem, _, unit = name.partition("_")
    return f"{stem}_after_{unit}"


# how a release ends
STOPS = ("time", "rest", "exit", "impacts", "spent", "buried", "reached")
UNRESOLVED_STOPS = ("time", "impacts", "buried")  # cut short, or outside the law: it could have gone on
STOP_TIME, STOP_REST, STOP_EXIT, STOP_IMPACTS, STOP_SPENT, STOP_BURIED, STOP_REACHED = range(len(STOPS))

# an instant: time and state (knots, ends, crossings)
INSTANT_NAMES = ("t_s", *STATE_NAMES)
TIME = 0
N_INSTANT = len(INSTANT_NAMES)
INSTANT_STATE = slice(1, 1 + N_STATE)  # the state in a row of an instant
INSTANT_X, INSTANT_Y, INSTANT_THETA, INSTANT_VX, INSTANT_VY, INSTANT_OMEGA = range(
    INSTANT_STATE.start, INSTANT_STATE.stop
)

# an impact as an engine records it: zone, instant before, instant after, largest penetration, largest force
IMPACT_NAMES = ("zone", *INSTANT_NAMES, *map(after, INSTANT_NAMES), "penetration_m", "force_N")
I_ZONE, I_TIME = 0, 1
I_BEFORE = I_TIME + 1
I_TIME_AFTER = I_TIME + N_INSTANT
I_AFTER = I_TIME_AFTER + 1
I_PENETRATION = I_TIME_AFTER + N_INSTANT
I_FORCE = I_PENETRATION + 1
N_IMPACT = len(IMPACT_NAMES)
BEFORE, AFTER = slice(I_BEFORE, I_BEFORE + N_STATE), slice(I_AFTER, I_AFTER + N_STATE)
BEFORE_INSTANT = slice(I_TIME, I_TIME + N_INSTANT)
AFTER_INSTANT = slice(I_TIME_AFTER, I_TIME_AFTER + N_INSTANT)
# a row of impacts.csv
IMPACT_COLUMNS = ("release", "block", *IMPACT_NAMES)

# a knot of a track: an instant, and whether the block flies freely to the next knot (1) or not (0)
KNOT_FLIGHT = N_INSTANT
N_KNOT = N_INSTANT + 1

# the energy audit of a release: the energy in J that each mechanism dissipated, all effects of the catalogue together
AUDIT_NAMES = ("plastic", "friction", "rolling", "effects")
PLASTIC, FRICTION, ROLLING, EFFECTS = range(len(AUDIT_NAMES))
# further columns while a release runs: velocity in m/s that the frame of recoiling ground adds to the block in an
# impact, and the displacements in m of this ground in the impact and since the start; in J the sum of corrections of
# steps, the correction that is still due, and the energy in contact springs at the end
RECOIL, RECOIL_SHIFT, GROUND_SHIFT, CORRECTED, PENDING, ELASTIC = range(len(AUDIT_NAMES), len(AUDIT_NAMES) + 6)
N_AUDIT = ELASTIC + 1
# the final energy balance in J: energy at the end, dissipated energy, kinetic and potential energy (above the lowest
# ground) at the start, residual of the balance (0 if it closes), and the sum of corrections of steps
ENERGY_NAMES = ("kinetic", "potential", "elastic", *AUDIT_NAMES, "initial", "residual", "corrected")
E_KINETIC, E_POTENTIAL, E_ELASTIC = range(3)
E_DISSIPATED = slice(E_ELASTIC + 1, E_ELASTIC + 1 + len(AUDIT_NAMES))
E_INITIAL, E_RESIDUAL, E_CORRECTED = range(E_DISSIPATED.stop, len(ENERGY_NAMES))
