"""An independent reality: filmed rockfall with hidden flaws, to test the diagnosis blind.

Law, geometry, integrator, effects and camera are written anew and share nothing with the toolkit that is tested: this
package imports numpy, numba and the standard library alone. SI units, angles counter-clockwise in rad.

`draw` chooses a hidden effect, `fall` lets blocks fall with it, `film` records what a camera makes of it.
"""

from __future__ import annotations

from rock2d.blind.reality.camera import film
from rock2d.blind.reality.catalogue import FORMS, OUTSIDE, draw
from rock2d.blind.reality.data_model import Block, Hidden, Law, Setup
from rock2d.blind.reality.ensemble import fall
from rock2d.blind.reality.outside import PHASES

__all__ = ["FORMS", "OUTSIDE", "PHASES", "Block", "Hidden", "Law", "Setup", "draw", "fall", "film"]
