"""The evidence of explanations against densities that scipy computes, and effects that begin within a campaign."""

import numpy as np
import pytest
from scipy import stats

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.campaign import considered_effects, gather
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.evidence import Linear, LogDensity, of_sizes, sizes_of
from femfit.identify.decision.naming import decide
from femfit.identify.noise.components import simulated_noise
from femfit.identify.readings.bench import placed
from femfit.identify.refit.add_effects import add_effects
from support.campaign import campaign

READINGS = 30


@pytest.fixture
def drawn():
    rng = np.random.default_rng(3)
    return 3.0 * rng.standard_normal(READINGS), rng.standard_normal((READINGS, 2)), rng.standard_normal((READINGS, 3))


def normal(y, *blocks):
    covariance = np.eye(READINGS) + sum(block @ block.T for block in blocks)
    return stats.multivariate_normal(np.zeros(READINGS), covariance).logpdf(y) + 0.5 * READINGS * np.log(2.0 * np.pi)


def linear(y, columns, density):
    result = Linear(y, columns, density, 0.0)
    triangle = np.linalg.slogdet(np.eye(READINGS) + columns @ columns.T)[1]
    return Linear(y, columns, density, float(density(result.square, triangle)))


def test_the_evidence_is_the_density_of_the_readings(drawn):
    y, columns, _ = drawn
    assert linear(y, columns, LogDensity(READINGS, np.inf)).log_evidence == pytest.approx(normal(y, columns), rel=1e-12)


def test_further_columns_at_a_fit_change_it_as_all_columns_together_do(drawn):
    y, columns, more = drawn
    one = linear(y, columns, LogDensity(READINGS, np.inf))
    beside = one.beside(more)
    gram, along = more.T @ more - beside.T @ beside, one.along(more, beside)
    sizes = np.array([0.1, 1.0, 7.0])
    together = [normal(y, columns, size * more) for size in sizes]
    np.testing.assert_allclose(one.with_more(gram, along, sizes)[0], together, rtol=1e-11)


def test_a_wide_guess_of_the_noise_is_never_taken_for_smaller_and_may_be_larger():
    guess, known = LogDensity(READINGS, 7.0, guessed=True), LogDensity(READINGS, np.inf)
    student = LogDensity(READINGS, 7.0)
    fewer, more = READINGS * np.array([0.1, 0.5, 1.0]), READINGS * np.array([1.0, 2.0, 20.0])
    np.testing.assert_allclose(np.diff(guess(fewer, 0.0)), np.diff(known(fewer, 0.0)), rtol=1e-12)
    np.testing.assert_allclose(np.diff(guess(more, 0.0)), np.diff(student(more, 0.0)), rtol=1e-12)


def test_noise_from_few_repeats_gives_students_density(drawn):
    y, columns, _ = drawn
    few = 7.0
    shape = np.eye(READINGS) + columns @ columns.T
    exact = stats.multivariate_t(np.zeros(READINGS), shape, df=few)
    other = stats.multivariate_t(np.zeros(READINGS), np.eye(READINGS), df=few)
    density = LogDensity(READINGS, few)
    nothing = linear(y, np.zeros((READINGS, 0)), density)
    assert linear(y, columns, density).log_evidence - nothing.log_evidence == pytest.approx(
        exact.logpdf(y) - other.logpdf(y), rel=1e-10
    )


def test_a_size_is_averaged_over_orders_of_magnitude(drawn):
    y, columns, _ = drawn
    alone = of_sizes(y, columns[:, :1], [np.array([0])], np.array([], dtype=int), LogDensity(READINGS, np.inf))
    sizes = sizes_of(float(np.linalg.norm(columns[:, 0])))
    assert sizes[0] * np.linalg.norm(columns[:, 0]) == pytest.approx(1.0)
    logs = [normal(y, size * columns[:, :1]) for size in sizes]
    assert alone.log_evidence == pytest.approx(np.logaddexp.reduce(logs) - np.log(len(logs)), rel=1e-12)


def test_all_probabilities_make_one(levitation_model):
    found = diagnose(levitation_model, campaign(levitation_model, 81), bootstrap=0)
    assert sum(found.probability.values()) == pytest.approx(1.0, abs=1e-9)
    assert found.verdict == "nothing_missing"


def test_simulated_readings_are_decided_alike_with_the_directions_of_the_first_and_their_own(levitation_model):
    observations = placed(levitation_model, campaign(levitation_model, 4))
    first = gather(observations, considered_effects())
    simulated = observations.base + simulated_noise(first.whitening, np.random.default_rng(2))
    own = decide(first.with_readings(simulated)).probability
    observations.of_settings.clear()
    decide(first)
    for word, probability in decide(first.with_readings(simulated)).probability.items():
        assert probability == pytest.approx(own[word], abs=1e-3)  # a tenth of a class's end


def test_an_effect_that_begins_between_two_runs_is_named_with_its_run_and_added_for_the_last(levitation_model):
    late = AddedEffect(effect_by_name("force_gain"), {"gain_error": 0.04})
    clean, wrong = (campaign(levitation_model, 82, effects, runs=4) for effects in ([], [late]))
    from_third = clean.rows["run"] >= clean.rows["run"].min() + 2
    clean.rows.loc[from_third, "force_N"] = wrong.rows.loc[from_third, "force_N"]
    found = diagnose(levitation_model, clean, bootstrap=0)
    assert [(one.name, one.runs) for one in found.missing] == [("force_gain", (3, 4))]
    assert found.to_dict()["missing"][0]["when"] == {"first_run": 3, "last_run": 4}
    assert "force_gain, from run 3 on" in str(found)
    better = add_effects(levitation_model, clean, found)
    (added,) = better.model.effects
    assert added.runs is None
    assert added.parameters["gain_error"] == pytest.approx(0.04, rel=0.1)
    force = next(one for one in better.fall.channels if one.channel == "force_N")
    assert force.after_over_noise < 1.15 < force.before_over_noise
