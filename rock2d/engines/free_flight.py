"""Free flight, compiled: the exact parabola, or fourth-order steps if air acts on the block; a lower bound of the time
to contact, by a tree over the facets.

Before a block touches a facet, a corner (or the lowest point of a circle) must reach the line of the facet, and the
block must reach the facet itself. The later of the two times is a lower bound. For a circle above the middle of a facet
it is the time of contact. With the tree, ten thousand facets cost little more than ten."""

import numpy as np

from rock2d.compiled import kernel, njit
from rock2d.effects.forces import flight
from rock2d.engines.geometry import (
    CONVEX,
    CORNER_X,
    CORNER_Y,
    LENGTH,
    NORMAL_X,
    NORMAL_Y,
    POINT_X,
    POINT_Y,
    TANGENT_X,
    TANGENT_Y,
    corner_place,
    facet_intersects,
    facet_range,
    is_ball,
    near_depth,
    polygon_depth,
    pose_of,
    profile_bend,
)
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y

# step of a flight through air, as a share of the time in which air or gravity change the motion by its own size
STRIDE_SHARE = 0.1
LEAF_FACETS = 4  # facets in a leaf
UNBOUNDED = 1.0e300  # bound of an empty box, and time of an event that never happens
# columns of a node: a box, and a line (normal, largest offset along it) above which no facet of the node rises
LOW_X, LOW_Y, HIGH_X, HIGH_Y, HULL_X, HULL_Y, HULL_OFFSET = range(7)


@kernel(forceinline=True)
def air_acts(block):
    """Whether air acts on the block."""
    return block.air.size > 0


@kernel
def fly(q, tau, gravity, block):
    """Advance q by tau (s) in place; returns the energy in J that air has dissipated.

    With air this is one classical Runge-Kutta step, and tau must be below `air_stride`."""
    if not air_acts(block):
        q[X] += q[VX] * tau
        q[Y] += q[VY] * tau - 0.5 * gravity * tau * tau
        q[THETA] += q[OMEGA] * tau
        q[VY] -= gravity * tau
        return 0.0
    mass, inertia = block.mass, block.inertia
    vx, vy, omega = q[VX], q[VY], q[OMEGA]
    ax = ay = alpha = 0.0
    dx = dy = dtheta = dvx = dvy = domega = work = 0.0
    for k in range(4):
        weight = 1.0 / 6.0 if k % 3 == 0 else 1.0 / 3.0
        if k > 0:
            ahead = 0.5 * tau if k < 3 else tau
            vx, vy, omega = q[VX] + ahead * ax, q[VY] + ahead * ay, q[OMEGA] + ahead * alpha
        ax, ay, alpha = flight(block.air, vx, vy, omega, mass, inertia)
        work -= weight * (mass * (ax * vx + ay * vy) + inertia * alpha * omega)
        ay -= gravity
        dx, dy, dtheta = dx + weight * vx, dy + weight * vy, dtheta + weight * omega
        dvx, dvy, domega = dvx + weight * ax, dvy + weight * ay, domega + weight * alpha
    q[X], q[Y], q[THETA] = q[X] + tau * dx, q[Y] + tau * dy, q[THETA] + tau * dtheta
    q[VX], q[VY], q[OMEGA] = q[VX] + tau * dvx, q[VY] + tau * dvy, q[OMEGA] + tau * domega
    return tau * work


@kernel
def air_stride(q, gravity, block):
    """(longest step in s, bound of the acceleration in m/s² that air adds meanwhile at any point of the block)."""
    if not air_acts(block):
        return np.inf, 0.0
    speed = np.sqrt(q[VX] * q[VX] + q[VY] * q[VY] + gravity * block.radius)
    spin = max(abs(q[OMEGA]), speed / block.radius)
    ax, ay, alpha = flight(block.air, q[VX], q[VY], q[OMEGA], block.mass, block.inertia)
    now = np.sqrt(ax * ax + ay * ay)
    stride = STRIDE_SHARE / max((now + gravity) / max(speed, 1e-300) + abs(alpha) / max(spin, 1e-300), 1e-12)
    bx, by, beta = flight(block.air, q[VX], q[VY] - gravity * stride, q[OMEGA], block.mass, block.inertia)
    then = np.sqrt(bx * bx + by * by)
    return stride, 2.0 * (max(now, then) + max(abs(alpha), abs(beta)) * block.radius)


@njit
def facet_tree(points):
    """(2 m, 7) nodes of a binary tree over the facets of `points` (n + 1, 2), C order.

    Node i has the children 2 i and 2 i + 1, the root is 1, the leaves m to 2 m - 1 hold LEAF_FACETS facets each."""
    n = len(points) - 1
    leaves = 1
    while leaves * LEAF_FACETS < n:
        leaves *= 2
    tree = np.empty((2 * leaves, 7))
    tree[:, :HIGH_X], tree[:, HIGH_X:] = UNBOUNDED, -UNBOUNDED
    held, first = LEAF_FACETS, leaves  # facets that a node holds, first node of the level
    while first >= 1:
        for k in range((n + held - 1) // held):
            begin, end = k * held, min((k + 1) * held, n)
            dx, dy = points[end, 0] - points[begin, 0], points[end, 1] - points[begin, 1]
            length = max(np.sqrt(dx * dx + dy * dy), 1e-300)
            node = tree[first + k]
            node[HULL_X], node[HULL_Y], node[HULL_OFFSET] = -dy / length, dx / length, -UNBOUNDED
            for i in range(begin, end + 1):
                x, y = points[i, 0], points[i, 1]
                node[LOW_X], node[LOW_Y] = min(node[LOW_X], x), min(node[LOW_Y], y)
                node[HIGH_X], node[HIGH_Y] = max(node[HIGH_X], x), max(node[HIGH_Y], y)
                node[HULL_OFFSET] = max(node[HULL_OFFSET], x * node[HULL_X] + y * node[HULL_Y])
        held, first = 2 * held, first // 2
    return tree


@kernel(forceinline=True)
def safe_time(distance, speed, gravity):
    """Time in s in which a point with initial `speed` and an acceleration of at most `gravity` covers `distance`."""
    if distance <= 0.0:
        return 0.0
    if gravity <= 0.0:
        return distance / max(speed, 1e-300)
    return 2.0 * distance / (speed + np.sqrt(speed * speed + 2.0 * gravity * distance))


@kernel(forceinline=True)
def _fall_time(gap, rate, pull):
    """First time t at which gap + rate t - ½ pull t² is not positive; UNBOUNDED if it stays positive."""
    if gap <= 0.0:
        return 0.0
    square = rate * rate + 2.0 * pull * gap
    if square < 0.0:
        return UNBOUNDED
    root = np.sqrt(square)
    if rate < 0.0:
        return 2.0 * gap / (root - rate)
    return (root + rate) / pull if pull > 0.0 else UNBOUNDED


@kernel(forceinline=True)
def _line_time(line, q, pose, pulls, block):
    """Lower bound of the time in s until a point of the block reaches the line n · p = offset.

    The height of a corner above it is a parabola, minus at most ½ ω² |r| t² by rotation and ½ `extra` t² by other
    forces. Rotation does not change the profile of a ball.

    line : (n_x, n_y, offset); pulls : (gravity, extra) in m/s²"""
    nx, ny, offset = line
    _, _, c, s = pose
    gravity, extra = pulls
    height, rate = q[X] * nx + q[Y] * ny - offset, q[VX] * nx + q[VY] * ny
    sides = block.sides
    n = sides.shape[0]
    if n == 0:
        if is_ball(block):
            return _fall_time(height - block.radius, rate, gravity * ny + extra)
        return _profile_time((nx, ny), height, rate, q, pose, gravity * ny + extra, block)
    height -= block.rounding
    soonest, pull = UNBOUNDED, gravity * ny + q[OMEGA] * q[OMEGA] * block.radius + extra
    for i in range(n):
        rx = c * sides[i, CORNER_X] - s * sides[i, CORNER_Y]
        ry = s * sides[i, CORNER_X] + c * sides[i, CORNER_Y]
        turning = q[OMEGA] * (rx * ny - ry * nx)
        soonest = min(soonest, _fall_time(height + rx * nx + ry * ny, rate + turning, pull))
    return soonest


@kernel
def _profile_time(normal, height, rate, q, pose, pull, block):
    """`_line_time` of a smooth profile that rotates: its lowest point moves down at its present rate, and by at most
    `profile_bend` ω² t² / 2 more."""
    nx, ny = normal
    _, _, c, s = pose
    a, b, omega = block.semi_a, block.semi_b, q[OMEGA]
    u, w = c * nx + s * ny, c * ny - s * nx
    h = np.sqrt(a * a * u * u + b * b * w * w)
    mx, my = c * block.centre_x - s * block.centre_y, s * block.centre_x + c * block.centre_y
    turning = omega * (mx * ny - my * nx - (a * a - b * b) * u * w / h)
    pull += omega * omega * profile_bend(block)
    return _fall_time(height + mx * nx + my * ny - h, rate + turning, pull)


@kernel
def _node_time(tree, node, q, pose, speed, pulls, block):
    if tree[node, LOW_X] > tree[node, HIGH_X]:
        return UNBOUNDED
    dx = max(max(tree[node, LOW_X] - q[X], q[X] - tree[node, HIGH_X]), 0.0)
    dy = max(max(tree[node, LOW_Y] - q[Y], q[Y] - tree[node, HIGH_Y]), 0.0)
    away = safe_time(max(np.sqrt(dx * dx + dy * dy) - block.radius, 0.0), speed, pulls[0] + pulls[1])
    down = _line_time((tree[node, HULL_X], tree[node, HULL_Y], tree[node, HULL_OFFSET]), q, pose, pulls, block)
    return max(away, down)


@kernel
def time_to_ground(q, gravity, block, facets, tree, stack, extra=0.0):
    """Lower bound in s of the time until the flying block touches a facet; `stack` is scratch of 64 integers.

    extra : bound of the acceleration in m/s² of any point of the block, without gravity and a steady spin"""
    leaves = tree.shape[0] // 2
    n = facets.shape[0] - 1
    pose, pulls = pose_of(q), (gravity, extra)
    speed = np.sqrt(q[VX] * q[VX] + q[VY] * q[VY])
    stack[0] = 1
    top, soonest = 1, UNBOUNDED
    while top > 0:
        top -= 1
        node = stack[top]
        if node < leaves:
            # search first the child that can be reached first
            near, far = 2 * node, 2 * node + 1
            t_near = _node_time(tree, near, q, pose, speed, pulls, block)
            t_far = _node_time(tree, far, q, pose, speed, pulls, block)
            if t_far < t_near:
                near, far, t_near, t_far = far, near, t_far, t_near
            if t_far < soonest:
                stack[top] = far
                top += 1
            if t_near < soonest:
                stack[top] = near
                top += 1
            continue
        start = (node - leaves) * LEAF_FACETS
        for f in range(start, min(start + LEAF_FACETS, n)):
            tx, ty = facets[f, TANGENT_X], facets[f, TANGENT_Y]
            px, py = facets[f, POINT_X], facets[f, POINT_Y]
            dx, dy = q[X] - px, q[Y] - py
            along = min(max(dx * tx + dy * ty, 0.0), facets[f, LENGTH])
            dx, dy = dx - along * tx, dy - along * ty
            away = safe_time(max(np.sqrt(dx * dx + dy * dy) - block.radius, 0.0), speed, gravity + extra)
            if away >= soonest:
                continue
            nx, ny = facets[f, NORMAL_X], facets[f, NORMAL_Y]
            down = _line_time((nx, ny, px * nx + py * ny), q, pose, pulls, block)
            soonest = min(soonest, max(away, down))
    return soonest


@kernel(forceinline=True)
def time_to_contact(q, extra, world, tree, stack, h_contact):
    """Lower bound in s of the time to contact of a flying block: `time_to_ground`, or for a polygon that may touch
    within a contact step the sharper one from `gap_to_ground`.

    extra : bound of the acceleration in m/s² without gravity; h_contact : contact step in s"""
    block, ground, gravity, radius = world.block, world.ground, world.gravity, world.block.radius
    tau = time_to_ground(q, gravity, block, ground.facets, tree, stack, extra)
    if tau < h_contact and block.sides.shape[0] > 0:
        near = facet_range(ground, q[X] - 2.0 * radius, q[X] + 2.0 * radius)
        gap = gap_to_ground(q, near, world)
        if gap > 0.0:
            # at most as far as the searched facets reach
            speed = np.sqrt(q[VX] * q[VX] + q[VY] * q[VY])
            tau = safe_time(min(gap, 0.5 * radius), speed + abs(q[OMEGA]) * radius, gravity + extra)
    return tau


@kernel
def gap_to_ground(q, near, world):
    """Lower bound in m of the distance between a polygon and the ground near it; 0 if the ground intersects the
    polygon, even as a ridge so thin that it contains no corner."""
    pose, block, ground = pose_of(q), world.block, world.ground
    facets, sides = ground.facets, block.sides
    f0, f1 = near
    gap = np.inf
    for i in range(sides.shape[0]):
        px, py = corner_place(i, pose, sides)
        depth, _, _ = near_depth(px, py, ground, f0, f1, min(gap, block.radius) + block.rounding)
        gap = min(gap, -depth - block.rounding)
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] > 0.0:
            depth, _ = polygon_depth(facets[v, POINT_X], facets[v, POINT_Y], pose, sides)
            gap = min(gap, -depth)
    for f in range(f0, f1):
        if gap > 0.0 and facet_intersects(f, pose, facets, sides):
            gap = 0.0
    return gap
