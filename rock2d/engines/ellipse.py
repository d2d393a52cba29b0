"""The nearest point of an ellipse, compiled."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import kernel


@kernel
def half_of_ellipse(px, py, a, b):
    """Half of the ellipse x²/a² + y²/b² = 1 that contains the point nearest to (px, py): 1 on the negative side of the
    longer axis, else 0."""
    return np.int64((py if a >= b else px) < 0.0)


@kernel
def nearest_on_ellipse(px, py, a, b, half):
    """Nearest point of the ellipse x²/a² + y²/b² = 1 to (px, py), by curvature-centre iteration (A. Kemper's method).

    half : half of the ellipse in which the search begins, see `half_of_ellipse`. Deep inside, each half has its own
        nearest point. If (px, py) crosses the longer axis, the point of the given half is followed, so that the depth
        of a contact is smooth. Near the ends of that axis, and outside, both halves give the same point.
    """
    upright = a < b
    if upright:
        px, py, a, b = py, px, b, a
    side = 1.0 - 2.0 * half
    qx, qy = abs(px), side * py
    tx, ty, change = np.sqrt(0.5), np.sqrt(0.5), 1.0
    for _ in range(30):
        ex, ey = (a * a - b * b) * tx**3 / a, (b * b - a * a) * ty**3 / b
        rx, ry = a * tx - ex, b * ty - ey
        dx, dy = qx - ex, qy - ey
        r, d = np.sqrt(rx * rx + ry * ry), np.sqrt(dx * dx + dy * dy)
        if d == 0.0:
            break
        nx, ny = max(0.0, (dx * r / d + ex) / a), (dy * r / d + ey) / b
        norm = np.sqrt(nx * nx + ny * ny)
        nx, ny = nx / norm, ny / norm
        change = abs(nx - tx) + abs(ny - ty)
        tx, ty = nx, ny
        if change < 1e-15:
            break
    if change > 1e-9 and qy >= 0.0:
        # near the centre of a thin ellipse the iteration can cycle
        tx, ty = _bisected(qx, qy, a, b)
    along, across = np.copysign(a * tx, px), side * b * ty
    return (across, along) if upright else (along, across)


@kernel
def _bisected(qx, qy, a, b):
    """(cos φ, sin φ) of the point (a cos φ, b sin φ) of an ellipse that is nearest to (qx, qy) in the first quadrant,
    by bisection of the derivative of the distance with respect to φ."""
    low, high = 0.0, 0.5 * np.pi
    for _ in range(55):
        phi = 0.5 * (low + high)
        c, s = np.cos(phi), np.sin(phi)
        if (b * b - a * a) * s * c + a * qx * s - b * qy * c > 0.0:
            high = phi
        else:
            low = phi
    return np.cos(phi), np.sin(phi)
