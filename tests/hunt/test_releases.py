"""A small hunt with fixed seeds: no release breaks physics, and the engines agree or there is a reason."""

import pytest

from tests.hunt.cases import Case
from tests.hunt.releases import check, compare, moved, random_releases, run_cases

SEED = 20261122
COUNT = 20  # sites of ten releases each


@pytest.mark.parametrize("chunk", [0, 1])
def test_no_release_breaks_physics(chunk):
    sites, states = random_releases(SEED, chunk, None, COUNT)
    result = run_cases(sites, states)
    found = [*check(sites, states, result), *moved(sites, states, result)]
    assert not [f"{f.fault} {f.size:.1e} {f.case.site.block.shape} [{f.stop}]" for f in found]


def test_the_engines_agree_or_there_is_a_reason():
    sites, states = random_releases(SEED, 2, None, COUNT)
    pairs = [compare(Case(site, starts[0])) for site, starts in zip(sites, states, strict=True)]
    compared = [pair for pair in pairs if pair is not None]
    assert len(compared) > COUNT / 2
    assert [pair.reason for pair in compared].count("") > 0.8 * len(compared)
    assert "unexplained" not in [pair.reason for pair in compared]
