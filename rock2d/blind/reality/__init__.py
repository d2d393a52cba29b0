"""An independent reality: filmed rockfall with hidden causes, to test the diagnosis blind.

Law, geometry, integrator, causes and camera are written a second time and share nothing with the toolkit that is
tested: this package imports numpy, numba and the standard library alone. SI units, angles counter-clockwise in rad.

`draw_hidden` draws the size of a hidden cause, `simulate_poses` simulates releases with it, `record_poses` gives what
a camera records of them."""

from rock2d.blind.reality.catalogue import FORMS, OUTSIDE, draw_hidden
from rock2d.blind.reality.data_model import Block, Camera, Hidden, Law, Releases, Setup, World
from rock2d.blind.reality.ensemble import record_poses, simulate_poses

__all__ = [
    "FORMS",
    "OUTSIDE",
    "Block",
    "Camera",
    "Hidden",
    "Law",
    "Releases",
    "Setup",
    "World",
    "draw_hidden",
    "record_poses",
    "simulate_poses",
]
