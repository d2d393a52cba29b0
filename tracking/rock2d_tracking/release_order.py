"""Which of the stated releases arcs show, where not every release shows one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def releases_shown(areas_px2: Sequence[float], stated_px2: Sequence[float]) -> list[int]:
    """Index of the stated release of each thing that was seen, in the order filmed: those with the best areas.

    areas_px2 : (n,) of what was seen, fewer than are stated
    stated_px2 : (m,) of the blocks of the stated releases

    The sum of |log(area / stated area)| is least; of equal choices the earliest releases are taken.
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
