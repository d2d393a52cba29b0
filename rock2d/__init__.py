"""rock2d: 2D rigid-body simulation of rockfall against embankments.

SI units; x toward the embankment, y up, angles counter-clockwise positive.
"""

__version__ = "0.1.0"
