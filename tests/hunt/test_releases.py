"""A small hunt with fixed seeds: no release breaks physics."""

import pytest

from tests.hunt.releases import check, moved, random_releases, run_cases

SEED = 20261122
COUNT = 20  # sites of ten releases each


@pytest.mark.parametrize("chunk", [0, 1])
def test_no_release_breaks_physics(chunk):
    sites, states = random_releases(SEED, chunk, None, COUNT)
    result = run_cases(sites, states)
    found = [*check(sites, states, result), *moved(sites, states, result)]
    assert not [f"{f.fault} {f.size:.1e} {f.case.site.block.shape} [{f.stop}]" for f in found]
