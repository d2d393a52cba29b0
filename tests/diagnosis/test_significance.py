"""How significant a gain is: by how many releases gain, not by how much a few of them do."""

import itertools

import numpy as np
import pytest

from rock2d.diagnosis.significance import Gain


def test_a_stronger_effect_is_no_less_significant():
    """The spread of the gains over releases grows with an effect; its significance must not fall with it."""
    rng = np.random.default_rng(3)
    shown, chance = rng.exponential(1.0, 30) ** 3, rng.normal(0.0, 0.5, 30)  # few releases show it clearly
    gains = [Gain(strength * shown + chance) for strength in (0.1, 0.3, 1.0, 4.0, 16.0, 64.0)]
    found = [gain.significance for gain in gains]
    assert all(later > earlier for earlier, later in itertools.pairwise(found))
    assert found[-1] > 4.0 and gains[-1].total < 3.0 * gains[-1].error  # by the plain spread it would be lost


def test_a_few_wild_releases_make_no_significant_gain():
    gain = np.full(40, -0.5)
    gain[[3, 11]] = 500.0
    assert Gain(gain).total > 900.0 and not Gain(gain).significant


def test_chance_is_rarely_significant():
    """Releases that gain by chance alone: as often as a normal deviate passes 2 standard errors."""
    rng = np.random.default_rng(1)
    share = np.mean([Gain(rng.normal(0.0, 2.0, 60)).significant for _ in range(4000)])
    assert share == pytest.approx(0.023, abs=0.008)
