"""Records of the compiled motion: named tuples of arrays and numbers."""

from typing import NamedTuple

from rock2d.blind.reality.data_model import Array

X, Y, THETA, VX, VY, OMEGA = range(6)  # columns of a state
K_L, K_UL, K_T, MU, K_R = range(5)  # columns of soil rows
# columns of `MotionInputs.bodies`: mass, inertia about the centre of mass, largest radius from it, rounding of the
# corners, position of the centroid, number of corners that share a contact (0: a circle), size
MASS, INERTIA, REACH, ROUNDING, CENTROID_X, CENTROID_Y, GROUP, SIZE = range(8)
BODY_WIDTH = SIZE + 1
# columns of the motion of the ground: the pivot about which it is turned and the angle, the shift of the embankment
# along x and its speed, the rise of all ground and its speed
PIVOT_X, PIVOT_Y, TILT, SHIFT, SHIFT_SPEED, RISE, RISE_SPEED = range(7)
N_GROUND_MOTION = RISE_SPEED + 1


class Ground(NamedTuple):
    """The ground: points (m, 2), ridges (m,); soil row `zone`, patch, and whether it yields, of each facet (m - 1,)."""

    points: Array
    zone: Array
    patch: Array
    ridges: Array
    yielding: Array


class Body(NamedTuple):
    """A block: corners (k, 2) from the centre of mass (a circle: its centre); see the columns of bodies."""

    corners: Array
    mass: float
    inertia: float
    reach: float
    rounding: float
    centroid_x: float
    centroid_y: float
    group: int
    size: float


class SoilLaw(NamedTuple):
    """Soil of each facet (n, 5), whether the rolling spring acts until the contact ends, gravity, `parameters`."""

    soil: Array
    indentation: bool
    gravity: float
    values: Array


class ImpactDraws(NamedTuple):
    """Random draws of each impact: factors on the soil (impacts, 5), tilt of the ground in rad, share of speed lost."""

    soil_factors: Array
    tilts: Array
    speed_losses: Array


class MotionInputs(NamedTuple):
    """Inputs that all releases of a call share.

    `corners` (blocks, most corners, 2) of which `corner_counts` (blocks,) are used; `bodies` (blocks, 8);
    `law.soil` has a row for each facet of the set-up."""

    ground: Ground
    corners: Array
    corner_counts: Array
    bodies: Array
    law: SoilLaw


class Contacts(NamedTuple):
    """Contacts as found (rows, 6), their memory (rows, 7), and sums over them."""

    found: Array
    memory: Array
    sums: Array


class ContactRows(NamedTuple):
    """Rows of contacts to check: 0 to `corners`, and `low` to `high`."""

    corners: int
    low: int
    high: int


class BlockMotion(NamedTuple):
    """State of a block, its velocity (3,) for forces, and the velocity (3,) of its path during the last `span_s`."""

    state: Array
    velocity: Array
    path_velocity: Array
    span_s: float


class ContactMotion(NamedTuple):
    """Motion at one contact: depth in m, rate of the depth and slip velocity in m/s; slip in m and rotation in rad
    since the last call."""

    depth: float
    rate: float
    slip_velocity: float
    slip: float
    rotation: float
