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


def test_an_addition_that_acts_in_few_releases_is_significant_and_wild_releases_are_not():
    rng = np.random.default_rng(2)
    none = rng.normal(0.0, 0.1, 60)
    first, wild = none.copy(), none.copy()
    first[:8], first[8] = 8.0, -4.0  # soil that changes in the first releases
    wild[[3, 20, 41]] = 300.0
    assert Gain(first).significance < 2.5 and Gain(first).p_of_addition < 0.004
    assert Gain(wild).p_of_addition > 0.01  # only a coincidence of three
    assert Gain(-first).p_of_addition > 0.9


def test_chance_seldom_makes_a_significant_addition():
    """Likelihood ratios of a law that is right: the mean of exp(gain) is 1."""
    rng = np.random.default_rng(1)
    gains = (Gain(rng.normal(-0.5 * spread**2, spread, 60)) for spread in (0.1, 0.3, 1.0) for _ in range(2000))
    assert np.mean([gain.significant_addition for gain in gains]) < 0.01
