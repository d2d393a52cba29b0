"""Names of the columns of states (n, 6) and poses (n, 3)."""

from __future__ import annotations

X, Y, THETA, VX, VY, OMEGA = range(6)
POSITION = slice(X, THETA)  # x, y
POSE = slice(X, VX)  # x, y, theta
LINEAR_VELOCITY = slice(VX, OMEGA)  # vx, vy
RATES = slice(VX, OMEGA + 1)  # vx, vy, omega
