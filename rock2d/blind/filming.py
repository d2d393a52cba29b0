"""What the camera of a case records, with and without hidden causes."""

from __future__ import annotations

import numpy as np

from rock2d.blind import reality
from rock2d.blind.cases import Case

Array = np.ndarray


def film_case(
    case: Case, times_s: Array, hidden: list[reality.Hidden], *, noisy: bool, soil_sd: Array | None = None
) -> Array:
    """(releases, frames, 3) recorded poses of a case with the causes `hidden` at work."""
    poses = reality.simulate_poses(
        case.world, case.releases, times_s, soil_sd=case.soil_sd if soil_sd is None else soil_sd, hidden=hidden,
        seed=case.seed,
    )  # fmt: skip
    camera = case.camera
    if not noisy:
        camera = reality.Camera(0.0, 0.0, camera.colour, 0.0, camera.centre_m, camera.extent_m)
    return reality.record_poses(poses, times_s, camera, hidden, case.seed + 1)
