"""What a practitioner would use without femfit, on the same files and the same columns: each gives a list of names.

References
----------
B. Efron et al., Annals of Statistics 32 (2004) 407: least-angle regression; C. M. Hurvich and C.-L. Tsai, Biometrika 76
(1989) 297: AICc; C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning (MIT Press, 2006),
section 5.4: model choice by marginal likelihood.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.identify.decision.campaign import considered_effects
from femfit.identify.noise.components import estimate_noise
from femfit.identify.readings.observations import Observations
from femfit.identify.signatures.columns import effect_columns, why_untestable
from support.trial_study.engine import CaseFiles

SOMETHING = "something"
"""What a method answers that can see a misfit and not name it."""

_GP_READINGS = 150
"""Of each channel: the work grows with the cube."""


@dataclass(frozen=True, eq=False)
class _Regression:
    """Residual and columns in noise sigmas, each column of unit length."""

    target: FloatArray
    columns: FloatArray
    names: tuple[str, ...]


def baseline_names(files: CaseFiles) -> dict[str, list[str]]:
    """What each baseline names.

    Returns
    -------
    dict of str to list of str
        ``lasso_bic``, ``stepwise_aicc`` and ``gaussian_process`` (which can only say that there is something).
    """
    observations = files.observations
    noise = estimate_noise(observations)
    if noise is None:
        return {"lasso_bic": [], "stepwise_aicc": [], "gaussian_process": []}
    sigma = noise.sigma[observations.channel]
    regression = _regression(observations, sigma)
    return {
        "lasso_bic": _lasso_bic(regression),
        "stepwise_aicc": _stepwise_aicc(regression),
        "gaussian_process": _gaussian_process(observations, sigma),
    }


def _regression(observations: Observations, sigma: FloatArray) -> _Regression:
    columns, names = [], []
    for effect in considered_effects():
        found = [] if why_untestable(effect, observations) else effect_columns(effect, observations)
        usual = {p.name: p.null for p in effect.parameters if p.nonlinear}
        found = [one for one in found if dict(one.shape) == usual] or found[:1]
        for one in found[:1]:
            for column in one.columns.T / sigma:
                size = float(np.linalg.norm(column))
                if size > 0.0:
                    columns.append(column / size)
                    names.append(effect.name)
    return _Regression(observations.residual / sigma, np.stack(columns, axis=1), tuple(names))


def _lasso_bic(regression: _Regression) -> list[str]:
    from sklearn.linear_model import LassoLarsIC

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # early stops of the path where columns nearly coincide
        fit = LassoLarsIC(criterion="bic", fit_intercept=False, noise_variance=1.0)
        fit.fit(regression.columns, regression.target)
    return list(dict.fromkeys(name for name, value in zip(regression.names, fit.coef_, strict=True) if value != 0.0))


def _stepwise_aicc(regression: _Regression) -> list[str]:
    """Add the effect that lowers AICc most while one does."""
    names = list(dict.fromkeys(regression.names))
    chosen: list[str] = []
    best = _aicc(regression, chosen)
    while len(chosen) < len(names):
        tried = {name: _aicc(regression, [*chosen, name]) for name in names if name not in chosen}
        name = min(tried, key=lambda n: tried[n])
        if tried[name] >= best:
            break
        best = tried[name]
        chosen.append(name)
    return chosen


def _aicc(regression: _Regression, chosen: list[str]) -> float:
    used = regression.columns[:, [name in chosen for name in regression.names]]
    rest = regression.target
    if used.shape[1]:
        rest = rest - used @ np.linalg.lstsq(used, rest, rcond=1e-8)[0]
    n, k = len(rest), used.shape[1] + 1
    return float(n * np.log(rest @ rest / n) + 2.0 * k + 2.0 * k * (k + 1) / max(n - k - 1, 1))


def _gaussian_process(observations: Observations, sigma: FloatArray) -> list[str]:
    """Whether a smooth function of distance and current makes the residual of some channel more probable than noise."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    place = np.stack([np.log(observations.column("distance_m")), observations.column("current_A")], axis=1)
    place = (place - place.mean(axis=0)) / np.maximum(place.std(axis=0), 1e-12)
    for name in observations.channels:
        here = np.flatnonzero(observations.of(name))
        here = here[:: max(1, len(here) // _GP_READINGS)]
        y = observations.residual[here] / sigma[here]
        kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF([1.0, 1.0], (0.1, 30.0)) + WhiteKernel(1.0, (0.2, 5.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # parameters at their bounds: a residual without structure
            smooth = GaussianProcessRegressor(kernel, n_restarts_optimizer=0).fit(place[here], y)
        variance = float(np.mean(y**2))
        noise_alone = -0.5 * len(y) * (np.log(2.0 * np.pi * variance) + 1.0)
        if smooth.log_marginal_likelihood_value_ - noise_alone > 1.5 * np.log(len(y)):  # three further parameters, BIC
            return [SOMETHING]
    return []
