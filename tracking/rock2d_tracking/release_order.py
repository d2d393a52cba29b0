"""Assignment of visible objects to the stated releases, if not all releases are visible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def releases_shown(areas_px2: Sequence[float], stated_px2: Sequence[float]) -> list[int]:
    """Index of the stated release of each visible object, in the order filmed.

    areas_px2 : (n,) of the visible objects, fewer than stated releases
    stated_px2 : (m,) of the blocks of the stated releases

    Minimises the sum of |log(area / stated area)|; among equal assignments, it takes the earliest releases.
    """
    miss = np.abs(np.log(np.asarray(areas_px2)[:, None] / np.asarray(stated_px2)))
    seen, stated = miss.shape
    least = np.full((seen + 1, stated + 1), np.inf)  # of the first k seen among the first m stated
    least[0] = 0.0
    for k in range(1, seen + 1):
        for m in range(k, stated + 1):
            least[k, m] = min(least[k, m - 1], least[k - 1, m - 1] + miss[k - 1, m - 1])
    chosen, m = [], stated
    for k in range(seen, 0, -1):
        while m > k and least[k, m - 1] <= least[k, m]:
            m -= 1
        chosen.append(m - 1)
        m -= 1
    return chosen[::-1]
