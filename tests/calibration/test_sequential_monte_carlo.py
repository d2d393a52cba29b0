"""The posterior sampler against posteriors that are known in closed form."""

import numpy as np
import pytest

from rock2d.calibration.sequential_monte_carlo import Factor, Moves, Quantity, Space, posterior, prior_draws

MEAN, SD = np.array([0.3, 0.6, 0.5]), np.array([0.03, 0.05, 0.04])


def gaussian(u):
    return -0.5 * (((u - MEAN) / SD) ** 2).sum(axis=1)


def sample(seed=0, **options):
    rng = np.random.default_rng(seed)
    return posterior(gaussian, prior_draws(4000, 3, rng), 1000, rng, Moves(**options))


def of_the_gaussian(found, near_mean: float, near_evidence: float, near_spread: float | None = 0.12) -> bool:
    """Hypotheses have the mean, the spread and the integral of the Gaussian, and their own likelihoods."""
    assert np.abs(found.u.mean(axis=0) - MEAN) == pytest.approx(0, abs=float(near_mean * SD.max()))
    assert near_spread is None or found.u.std(axis=0) == pytest.approx(SD, rel=near_spread)
    integral = np.log(np.prod(SD * np.sqrt(2 * np.pi)))  # nothing of it lies outside the unit cube
    assert found.log_evidence == pytest.approx(integral, abs=near_evidence)
    return found.log_likelihood == pytest.approx(gaussian(found.u))


def test_a_gaussian_likelihood_gives_its_mean_its_spread_and_its_integral():
    assert of_the_gaussian(sample(count=6), 4 / np.sqrt(1000), 0.25)


def test_without_data_the_prior_stays():
    rng = np.random.default_rng(1)
    found = posterior(lambda u: np.zeros(len(u)), prior_draws(2000, 2, rng), 2000, rng, Moves(5))
    shares = np.histogram(found.u[:, 0], 10, (0.0, 1.0))[0] / 2000
    assert shares == pytest.approx(0.1, abs=0.03)  # walks reflected at the walls keep it flat up to the walls
    assert found.log_evidence == pytest.approx(0.0, abs=1e-12)


def test_a_choice_among_models_gets_its_posterior_probability():
    """Two models whose likelihoods differ by a factor 3, chosen by one half of a redrawn column each."""

    def likelihood(u):
        return np.where(u[:, 0] < 0.5, np.log(3.0), 0.0) + gaussian(u[:, 1:])

    rng = np.random.default_rng(2)
    found = posterior(likelihood, prior_draws(8000, 4, rng), 2000, rng, Moves(6, redrawn=np.array([0])))
    assert (found.u[:, 0] < 0.5).mean() == pytest.approx(0.75, abs=0.05)


def test_the_same_seed_gives_the_same_bits():
    first, second, other = sample(), sample(), sample(seed=3)
    assert (first.u == second.u).all() and not (first.u == other.u).all()


def test_an_impossible_prior_is_said():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="no draw of the prior is possible"):
        posterior(lambda u: np.full(len(u), -np.inf), prior_draws(64, 1, rng), 16, rng)


def test_values_of_a_space():
    space = Space((Quantity("a_m", 2.0, 4.0), Quantity("b_N_m", 1.0, 100.0, log=True)))
    values = space.values(np.array([[0.5, 0.5]]))
    assert values["a_m"] == pytest.approx(3.0) and values["b_N_m"] == pytest.approx(10.0)
    assert space.columns(["b_N_m"]).tolist() == [1]
    with pytest.raises(KeyError):
        space.columns(["c"])


def factors(asked, highest=np.inf):
    """The same Gaussian in two factors; `asked` gets the number of the factor of each hypothesis at each call."""

    def factor(k, columns):
        def log_likelihood(u):
            asked.extend([k] * len(u))
            return -0.5 * (((u[:, columns] - MEAN[columns]) / SD[columns]) ** 2).sum(axis=1)

        return Factor(log_likelihood, np.array(columns), highest)

    return [factor(0, [0, 1]), factor(1, [2])]


def test_factors_that_move_in_groups_give_the_posterior_of_their_product():
    rng, groups = np.random.default_rng(4), [np.array([0, 1]), np.array([2])]
    found = posterior(factors([]), prior_draws(4000, 3, rng), 1000, rng, Moves(6, groups=groups))
    assert of_the_gaussian(found, 4 / np.sqrt(1000), 0.25)


def test_a_group_computes_only_the_factors_that_depend_on_it():
    asked = []
    rng = np.random.default_rng(5)
    posterior(factors(asked), prior_draws(400, 3, rng), 100, rng, Moves(3, groups=[np.array([2])]))
    assert asked.count(0) == 400 and asked.count(1) > 400 + 3 * 100


def test_a_bound_refuses_the_same_proposals_and_computes_less():
    found, asked = [], []
    for highest in (np.inf, 0.0):
        rng = np.random.default_rng(5)
        counted: list[int] = []
        found.append(posterior(factors(counted, highest), prior_draws(400, 3, rng), 100, rng, Moves(3)).u)
        asked.append([counted.count(k) for k in range(2)])
    assert (found[0] == found[1]).all()
    assert asked[1][0] == asked[0][0] and asked[1][1] < 0.8 * asked[0][1]


def test_hypotheses_that_one_factor_excludes_reach_no_further_one():
    seen = []

    def later(u):
        seen.append(u[:, 0].min())
        return np.zeros(len(u))

    half = Factor(lambda u: np.where(u[:, 0] < 0.5, -np.inf, 0.0), np.array([0]))
    rng = np.random.default_rng(6)
    found = posterior([half, Factor(later, np.array([0, 1]))], prior_draws(400, 2, rng), 100, rng, Moves(3))
    assert min(seen) >= 0.5 and found.u[:, 0].min() >= 0.5
    assert found.log_evidence == pytest.approx(np.log(0.5), abs=1e-2)


def test_the_hypotheses_of_every_round_are_the_posterior_too():
    """A third of the moves of as many hypotheses; the number is a multiple of the rounds."""
    rng = np.random.default_rng(8)
    moves = Moves(4, groups=[np.array([0, 1]), np.array([2])], every_round=True)
    found = posterior(factors([]), prior_draws(4000, 3, rng), 2002, rng, moves)
    assert len(found.u) == 2000
    assert of_the_gaussian(found, 6 / np.sqrt(500), 0.3, 0.15)


def test_fewer_hypotheses_than_rounds_still_move():
    rng = np.random.default_rng(8)
    found = posterior(factors([]), prior_draws(16, 3, rng), 3, rng, Moves(4, every_round=True))
    assert len(found.u) == 8 and np.isfinite(found.u).all()
    assert len(np.unique(found.u, axis=0)) > 2


def test_finer_factors_decide_whatever_the_coarse_ones_were():
    rng, asked = np.random.default_rng(9), []
    shifted = Factor(lambda u: gaussian(np.abs(u - 0.1)), np.arange(3))
    finer = 0.2, factors(asked)
    found = posterior([shifted], prior_draws(4000, 3, rng), 1000, rng, Moves(6), finer=finer)
    assert of_the_gaussian(found, 4 / np.sqrt(1000), 0.3, None)
    assert 0 < asked.count(0) < 1000 * 100
