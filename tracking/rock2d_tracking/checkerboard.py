"""Metres per pixel from a picture of a checkerboard in the plane of motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rock2d.errors import InputError
from rock2d.files.folders import path_inside
from rock2d.files.text_files import require_regular

LARGEST_SCALE_SPREAD = 0.02  # over the board; a larger one shows that the camera was oblique


def scale_of_board(folder: Path, picture: str, corners: tuple[int, int], square_m: float) -> float:
    """Metres per pixel; `corners`: number of inner corners in a row, and number of rows.

    Raises InputError if the picture cannot be read, the board is not found, or the view is oblique.
    """
    import cv2

    try:
        path = path_inside(folder, picture)
    except ValueError as error:
        raise InputError(str(error)) from None
    require_regular(path)
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise InputError("cannot be read as a picture", path)
    found, points = cv2.findChessboardCorners(image, corners)
    if not found:
        raise InputError(f"no checkerboard of {corners[0]} × {corners[1]} inner corners found", path)
    precise = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    grid = cv2.cornerSubPix(image, points, (5, 5), (-1, -1), precise).reshape(corners[1], corners[0], 2)
    along, across = (np.hypot(*np.moveaxis(np.diff(grid, axis=k), -1, 0)) for k in (1, 0))
    sides = np.concatenate([along.ravel(), across.ravel()])
    halves = [along[:, : corners[0] // 2], along[:, corners[0] // 2 :], across[: corners[1] // 2], across]
    uneven = float(np.ptp([np.mean(h) for h in halves]) / np.mean(sides))
    if uneven > LARGEST_SCALE_SPREAD:
        raise InputError(
            f"the camera looks at the board at a slant: its squares differ by {100 * uneven:.1f} %", path
        )
    return float(square_m / np.mean(sides))
