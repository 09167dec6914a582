"""What a practitioner would use without femfit, on the same readings: each gives names and a correction of the model.

LASSO and stepwise selection see one column for each number of each effect and each number of the drawing, as the
decision does. Sparse regression on powers, symbolic regression and a Gaussian process see distance, current and the
predicted force, one channel after the other; what they find are terms, not names.

References
----------
B. Efron et al., Annals of Statistics 32 (2004) 407: least-angle regression; C. M. Hurvich and C.-L. Tsai, Biometrika 76
(1989) 297: AICc; S. L. Brunton, J. L. Proctor and J. N. Kutz, PNAS 113 (2016) 3932: SINDy; J. R. Koza, Genetic
Programming (MIT Press, 1992); M. Keijzer, EuroGP 2003, LNCS 2610, 70: scaled formulas; C. E. Rasmussen and C. K. I.
Williams, Gaussian Processes for Machine Learning (MIT Press, 2006), section 5.4: model choice by marginal likelihood.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.distance_scale import even_scale
from femfit.effects.conditions import Conditions
from femfit.identify.comparison.patterns import scaled_to_one
from femfit.identify.decision.campaign import considered_effects
from femfit.identify.noise.components import estimate_noise
from femfit.identify.readings.observations import Observations
from femfit.identify.signatures.columns import effect_columns, why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from support.trial_study.engine import CaseFiles

_GP_READINGS = 150
"""Of each channel: the work grows with the cube."""

_DEGREE = 4
"""Of the powers of distance, current and force."""

_THRESHOLDS = tuple(np.geomspace(0.03, 10.0, 8))
"""Coefficients, in standard deviations of a reading, below which a power is left out: the best by BIC is taken."""

_POPULATION, _GENERATIONS, _SYMBOLIC_READINGS = 120, 6, 150
"""For the time that it takes, some three seconds a campaign."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A campaign's misfit as regression takes it, in standard deviations of a reading."""

    sigma: FloatArray  # That of each reading, in its unit; shape (M,)
    target: FloatArray  # Recorded minus predicted; shape (M,)
    seen: BoolArray  # Readings that may be fitted; shape (M,)
    columns: FloatArray  # First-order changes, each of unit length over the readings that are seen; shape (M, k)
    names: tuple[str, ...]  # Of the columns
    place: FloatArray  # Distance, current and predicted force, each from -1 to 1; shape (M, 3)
    channels: tuple[str, ...]
    channel: FloatArray  # Shape (M,)

    def of(self, channel: int) -> tuple[FloatArray, FloatArray]:
        """Numbers of a channel's readings: all, and those that are seen."""
        here = self.channel == channel
        return np.flatnonzero(here), np.flatnonzero(here & self.seen)

    def only(self, seen: BoolArray) -> "Problem":
        """The same with other readings to be fitted."""
        return replace(self, seen=seen, columns=_of_unit_length(self.columns, seen))


@dataclass(frozen=True, eq=False)
class Answer:
    """What a method makes of a problem."""

    names: tuple[str, ...]
    correction: FloatArray  # Of the prediction, at all readings, in standard deviations; shape (M,)


Method = Callable[[Problem], Answer]


def make_problem(model: ActuatorModel, observations: Observations) -> Problem | None:
    """The regression problem of a campaign with all readings seen; None where its noise is unknown."""
    noise = estimate_noise(observations)
    if noise is None:
        return None
    sigma, nominal = noise.sigma[observations.channel], observations.nominal
    columns, names = [], []
    for effect in considered_effects((), nominal.circuits, nominal.drawn):
        found = [] if why_untestable(effect, observations) else effect_columns(effect, observations)
        usual = {p.name: p.null for p in effect.parameters if p.nonlinear}
        for one in ([one for one in found if dict(one.shape) == usual] or found)[:1]:
            kept = [column for column in one.columns.T / sigma if np.isfinite(column).all() and column.any()]
            columns += kept
            names += [effect.name] * len(kept)
    seen = np.ones(len(sigma), dtype=bool)
    distance, current = observations.column("distance_m"), observations.column("current_A")
    force = predict_readings(model, distance, current, Conditions(nominal), channels=("force_N",))["force_N"]
    return Problem(
        sigma,
        observations.residual / sigma,
        seen,
        _of_unit_length(np.stack(columns, axis=1), seen),
        tuple(names),
        np.stack([scaled_to_one(one) for one in (even_scale(distance), current, force)], axis=1),
        observations.channels,
        observations.channel,
    )


def _of_unit_length(columns: FloatArray, seen: BoolArray) -> FloatArray:
    """What shows in none of the readings that are seen becomes zero."""
    length = np.linalg.norm(columns[seen], axis=0)
    return np.asarray(np.where(length > 0.0, columns / np.maximum(length, 1e-300), 0.0))


def lasso_bic(problem: Problem) -> Answer:
    """Least-angle regression, stopped by BIC."""
    from sklearn.linear_model import LassoLarsIC

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # early stops of the path where columns nearly coincide
        fit = LassoLarsIC(criterion="bic", fit_intercept=False, noise_variance=1.0)
        fit.fit(problem.columns[problem.seen], problem.target[problem.seen])
    names = dict.fromkeys(name for name, value in zip(problem.names, fit.coef_, strict=True) if value != 0.0)
    return Answer(tuple(names), problem.columns @ fit.coef_)


def stepwise_aicc(problem: Problem) -> Answer:
    """Add the effect that lowers AICc most while one does."""
    columns, rest = problem.columns[problem.seen], problem.target[problem.seen]
    places = {name: [k for k, n in enumerate(problem.names) if n == name] for name in dict.fromkeys(problem.names)}
    chosen: list[str] = []
    best, square, count = _aicc(len(rest), float(rest @ rest), 0), float(rest @ rest), 0
    left = columns.copy()  # orthogonal to what is chosen
    while len(chosen) < len(places):
        tried = {}
        for name in places.keys() - set(chosen):
            basis = _basis(left[:, places[name]])
            fall = float(np.sum((basis.T @ rest) ** 2))
            tried[name] = _aicc(len(rest), square - fall, count + len(places[name])), fall, basis
        name = min(sorted(tried), key=lambda one: tried[one][0])
        if tried[name][0] >= best:
            break
        best, fall, basis = tried[name]
        square, count = square - fall, count + len(places[name])
        rest, left = rest - basis @ (basis.T @ rest), left - basis @ (basis.T @ left)
        chosen.append(name)
    used = [k for name in chosen for k in places[name]]
    size = np.linalg.lstsq(columns[:, used], problem.target[problem.seen], rcond=1e-8)[0]
    return Answer(tuple(chosen), problem.columns[:, used] @ size)


def _aicc(n: int, square: float, columns: int) -> float:
    k = columns + 1
    return float(n * np.log(square / n) + 2.0 * k + 2.0 * k * (k + 1) / max(n - k - 1, 1))


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal columns of what was of unit length before others were taken out of it."""
    vectors, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(vectors[:, sizes > 1e-4])


def pysindy_powers(problem: Problem) -> Answer:
    """Sequentially thresholded least squares on powers of distance, current and force, one channel after the other."""
    import pysindy

    correction, names = np.zeros(len(problem.target)), list[str]()
    for c, channel in enumerate(problem.channels):
        here, seen = problem.of(c)
        y, best = problem.target[seen], (float(np.sum(problem.target[seen] ** 2)), None)
        for threshold in _THRESHOLDS:
            fit = pysindy.SINDy(
                optimizer=pysindy.STLSQ(threshold=threshold, alpha=1e-6),
                feature_library=pysindy.PolynomialLibrary(degree=_DEGREE),
            )
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # all powers were left out, or fewer readings than powers
                fit.fit(problem.place[seen], 1.0, x_dot=y[:, None], feature_names=["distance", "current", "force"])
            left = y - np.asarray(fit.predict(problem.place[seen]))[:, 0]
            bic = float(left @ left) + np.count_nonzero(fit.coefficients()) * np.log(len(y))
            best = min(best, (bic, fit), key=lambda pair: pair[0])
        if best[1] is not None:
            correction[here] = np.asarray(best[1].predict(problem.place[here]))[:, 0]
            terms = zip(best[1].get_feature_names(), best[1].coefficients()[0], strict=True)
            names += [f"{channel}: {term}" for term, size in terms if size != 0.0]
    return Answer(tuple(names), correction)


def symbolic_regression(problem: Problem) -> Answer:
    """The best formula of a genetic programme, scaled, where it is worth its length by BIC, channel after channel."""
    from gplearn.genetic import SymbolicRegressor

    correction, names = np.zeros(len(problem.target)), list[str]()
    for c, channel in enumerate(problem.channels):
        here, seen = problem.of(c)
        few = seen[:: max(1, len(seen) // _SYMBOLIC_READINGS)]
        fit = SymbolicRegressor(
            population_size=_POPULATION,
            generations=_GENERATIONS,
            metric="pearson",  # of the form: its scale and zero are fitted to what is found
            parsimony_coefficient=1e-3,
            feature_names=["distance", "current", "force"],
            random_state=1,
        )
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # formulas that overflow, or are one number
            fit.fit(problem.place[few], problem.target[few])
            formula = fit.predict(problem.place)
        if not np.isfinite(formula[here]).all():
            continue
        scaled, y = np.stack([formula, np.ones(len(formula))], axis=1), problem.target[seen]
        size = np.linalg.lstsq(scaled[seen], y, rcond=None)[0]
        left = y - scaled[seen] @ size
        if left @ left + (fit._program.length_ + 2) * np.log(len(y)) < y @ y:
            correction[here] = scaled[here] @ size
            names.append(f"{channel}: {fit._program}")
    return Answer(tuple(names), correction)


def gaussian_process(problem: Problem) -> Answer:
    """A smooth function of distance and current, where it makes a channel's residual more probable than noise."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    place = problem.place[:, :2] / np.maximum(problem.place[:, :2].std(axis=0), 1e-12)
    correction, names = np.zeros(len(problem.target)), list[str]()
    for c, channel in enumerate(problem.channels):
        here, seen = problem.of(c)
        few = seen[:: max(1, len(seen) // _GP_READINGS)]
        y = problem.target[few]
        kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF([1.0, 1.0], (0.1, 30.0)) + WhiteKernel(1.0, (0.2, 5.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # parameters at their bounds: a residual without structure
            smooth = GaussianProcessRegressor(kernel, n_restarts_optimizer=0).fit(place[few], y)
        variance = float(np.mean(y**2))
        noise_alone = -0.5 * len(y) * (np.log(2.0 * np.pi * variance) + 1.0)
        if smooth.log_marginal_likelihood_value_ - noise_alone > 1.5 * np.log(len(y)):  # three further parameters, BIC
            correction[here] = smooth.predict(place[here])
            names.append(f"{channel}: something")
    return Answer(tuple(names), correction)


METHODS: Mapping[str, tuple[str, Method]] = {
    "LASSO, BIC": ("sklearn", lasso_bic),
    "stepwise, AICc": ("sklearn", stepwise_aicc),
    "PySINDy": ("pysindy", pysindy_powers),
    "symbolic regression": ("gplearn", symbolic_regression),
    "Gaussian process": ("sklearn", gaussian_process),
}
"""Each with the package that it needs."""


def installed() -> dict[str, Method]:
    """The methods whose package is there."""
    return {name: method for name, (package, method) in METHODS.items() if find_spec(package)}


def baseline_names(files: CaseFiles) -> dict[str, list[str]]:
    """What each installed baseline names in a case of the older study."""
    problem = make_problem(files.model, files.observations)
    return {name: [] if problem is None else list(method(problem).names) for name, method in installed().items()}
