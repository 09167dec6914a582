"""The comparison of docs/trial.md with LASSO, stepwise selection, PySINDy and a Gaussian process.

``python tests/benchmarks/baselines.py runs/rig runs/voice`` reads directories that ``other_physics.py final`` wrote,
tries femfit and each method whose package is installed (extra ``baselines``) on all their campaigns, and prints one
table for each directory. Each gives names and a correction of the model.

LASSO and stepwise selection see one column for each number of each effect and each number of the drawing, as the
decision does. Sparse regression on powers and a Gaussian process see distance, current and the predicted force, one
channel after the other; what they find are terms, not names.

For the error, what is wrong is found and fitted without the last run of a campaign, and the corrected model predicts
that run. Where the body was put back no model can know: a common shift of the run, as large as the mounts of this bench
scatter, is predicted from the run itself, for every method alike.

References
----------
B. Efron et al., Annals of Statistics 32 (2004) 407: least-angle regression; C. M. Hurvich and C.-L. Tsai, Biometrika 76
(1989) 297: AICc; S. L. Brunton, J. L. Proctor and J. N. Kutz, PNAS 113 (2016) 3932: SINDy; C. E. Rasmussen
and C. K. I. Williams, Gaussian Processes for Machine Learning (MIT Press, 2006), section 5.4: marginal likelihood.
"""

import argparse
import json
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from femfit.cli.output import progress
from femfit.core.errors import FemfitError
from femfit.core.files import write_json
from femfit.core.numerics import BoolArray, FloatArray, even_scale
from femfit.effects.conditions import Conditions
from femfit.identify.add_effects import add_effects
from femfit.identify.bench import placed
from femfit.identify.decision.campaign import considered_effects
from femfit.identify.decision.diagnose import Diagnosis, diagnose
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import NoiseModel, Whitening, random_columns
from femfit.identify.observations import Observations
from femfit.identify.patterns import scaled_to_one
from femfit.identify.signatures import effect_columns, why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.model.readings import predict_readings
from femfit.tables.measurement import BenchTable
from femfit.tables.measurement_file import read_bench_table
from femfit.trial.counts import COULD_BE_SHOWN, LEAST_LEVEL, Share, judge
from femfit.trial.virtual_bench import Meter
from support.trial.campaigns import judged

_GP_READINGS = 150
"""Of each channel: the work grows with the cube."""

_DEGREE = 4
"""Of the powers of distance, current and force."""

_THRESHOLDS = tuple(np.geomspace(0.03, 10.0, 8))
"""Coefficients, in standard deviations of a reading, below which a power is left out: the best by BIC is taken."""


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
    for effect in considered_effects((), nominal):
        changes = [] if why_untestable(effect, observations) else effect_columns(effect, observations)
        usual = {p.name: p.null for p in effect.parameters if p.nonlinear}
        for change in ([change for change in changes if dict(change.shape) == usual] or changes)[:1]:
            finite = [column for column in change.columns.T / sigma if np.isfinite(column).all() and column.any()]
            columns += finite
            names += [effect.name] * len(finite)
    seen = np.ones(len(sigma), dtype=bool)
    distance, current = observations.column("distance_m"), observations.column("current_A")
    force = predict_readings(model, distance, current, Conditions(nominal), channels=("force_N",))["force_N"]
    return Problem(
        sigma,
        observations.residual / sigma,
        seen,
        _of_unit_length(np.stack(columns, axis=1), seen),
        tuple(names),
        np.stack([scaled_to_one(values) for values in (even_scale(distance), current, force)], axis=1),
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
    orthogonal = columns.copy()  # to what is chosen
    while len(chosen) < len(places):
        tried = {}
        for name in places.keys() - set(chosen):
            basis = _basis(orthogonal[:, places[name]])
            fall = float(np.sum((basis.T @ rest) ** 2))
            tried[name] = _aicc(len(rest), square - fall, count + len(places[name])), fall, basis
        name = min(sorted(tried), key=lambda candidate: tried[candidate][0])
        if tried[name][0] >= best:
            break
        best, fall, basis = tried[name]
        square, count = square - fall, count + len(places[name])
        rest = rest - basis @ (basis.T @ rest)
        orthogonal = orthogonal - basis @ (basis.T @ orthogonal)
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
            residual = y - np.asarray(fit.predict(problem.place[seen]))[:, 0]
            bic = float(residual @ residual) + np.count_nonzero(fit.coefficients()) * np.log(len(y))
            best = min(best, (bic, fit), key=lambda pair: pair[0])
        if best[1] is not None:
            correction[here] = np.asarray(best[1].predict(problem.place[here]))[:, 0]
            terms = zip(best[1].get_feature_names(), best[1].coefficients()[0], strict=True)
            names += [f"{channel}: {term}" for term, size in terms if size != 0.0]
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
    "Gaussian process": ("sklearn", gaussian_process),
}
"""Each with the package that it needs."""


def installed() -> dict[str, Method]:
    """The methods whose package is there."""
    return {name: method for name, (package, method) in METHODS.items() if find_spec(package)}


AS_DRAWN, FEMFIT = "model as drawn", "femfit"

NOTHING, ONE, UNSEEN = "nothing", "one", "unseen"
"""Campaigns that hide nothing, one error of 1 sigma and more that could be shown, or such a cause without a name."""


@dataclass(frozen=True)
class Verdict:
    """What a method made of a campaign."""

    method: str
    hides: str  # NOTHING, ONE or UNSEEN
    something: bool  # Whether it says that the model lacks something
    right: bool  # Whether the truth is among its names
    names: int
    over_noise: float | None  # Error on the run left out; None where there is one run, or the error comes and goes


def compare_methods(directory: Path, progress: Callable[[int, int], None]) -> list[Verdict]:
    """Try femfit and all installed methods on the campaigns of a directory that other_physics.py has written."""
    model, campaigns = read_model(directory / "model.json"), sorted((directory / "campaigns").iterdir())
    verdicts: list[Verdict] = []
    for done, campaign in enumerate(campaigns):
        progress(done, len(campaigns))
        key = json.loads((campaign / "hidden.json").read_text(encoding="utf-8"))
        verdicts += _campaign(model, read_bench_table(campaign / "data.csv"), key)
    progress(len(campaigns), len(campaigns))
    return verdicts


def _campaign(model: ActuatorModel, data: BenchTable, key: dict[str, Any]) -> list[Verdict]:
    """What every method makes of a campaign; nothing of one that is not counted."""
    diagnosis = _diagnosed(model, data) if _is_counted(key) else None
    if diagnosis is None:
        return []
    outcome, answer = judge(0, key, diagnosis.to_dict()), diagnosis.to_dict()
    groups = judged(outcome, key, answer).groups
    hides = NOTHING if not outcome.hidden else UNSEEN if "unseen" in groups else ONE
    observations = placed(model, data)
    last = observations.column("run") == observations.runs - 1
    predicts = observations.runs > 1 and groups != ("when",)
    as_drawn = _error(observations, observations.base, key) if predicts else None
    drawn = Verdict(AS_DRAWN, hides, False, False, 0, as_drawn)
    names = sum(map(len, outcome.classes))
    named = bool(names) or outcome.verdict == "unexplained"
    after = _error_after_add(model, data, observations.runs, key) if predicts else None
    verdicts = [drawn, Verdict(FEMFIT, hides, named, bool(outcome.found) and all(outcome.found), names, after)]
    problem = make_problem(model, observations)
    if problem is None:  # without a noise no method has a scale
        return [*verdicts, *(replace(drawn, method=name) for name in installed())]
    for name, method in installed().items():
        correction, error = method(problem), drawn.over_noise
        if predicts and correction.names:  # what all runs do not show, fewer do not
            fitted = method(problem.only(~last)).correction * problem.sigma
            error = _error(observations, observations.base + fitted, key)
        right = judge(0, key, answer | {"missing": [{"class": [term]} for term in correction.names]}).found
        something = bool(correction.names)
        verdicts.append(Verdict(name, hides, something, bool(right) and all(right), len(correction.names), error))
    return verdicts


def _diagnosed(model: ActuatorModel, data: BenchTable) -> Diagnosis | None:
    try:
        return diagnose(model, data)
    except FemfitError:
        return None


def _is_counted(key: dict[str, Any]) -> bool:
    """Whether a campaign hides nothing, or one error of 1 sigma and more that could be shown."""
    shown = list(key["shown"].values())
    return not shown or (len(shown) == 1 and key["level"] >= LEAST_LEVEL and shown[0] >= COULD_BE_SHOWN)


def _error_after_add(model: ActuatorModel, data: BenchTable, runs: int, key: dict[str, Any]) -> float | None:
    """That of the model after ``femfit add`` of what the other runs are said to lack."""
    rows = data.rows
    before = replace(data, rows=rows[pd.factorize(rows["run"])[0] < runs - 1].reset_index(drop=True))
    diagnosis = _diagnosed(model, before)
    try:
        if diagnosis and diagnosis.missing:
            model = add_effects(model, before, diagnosis).model
    except FemfitError:  # these readings are too few to add anything
        pass
    observations = placed(model, data)
    return _error(observations, observations.base, key)


def beside_random(residual: FloatArray, whitening: Whitening) -> FloatArray:
    """A residual, shape (M,), without the best linear unbiased prediction of its re-mounts and runs."""
    columns = random_columns(whitening.observations, whitening.noise.mount_m, whitening.noise.run)
    white = whitening.serial(columns)
    size = np.linalg.solve(white.T @ white + np.eye(white.shape[1]), white.T @ whitening.serial(residual))
    return np.asarray(residual - columns @ size)


def _error(observations: Observations, predicted: FloatArray, key: dict[str, Any]) -> float:
    """Root mean square over the true noise in the last run, over all channels, the run's shift predicted."""
    last = observations.column("run") == observations.runs - 1
    unseen, names = observations.select(last), observations.channels
    meters = [Meter(**key["meters"][name]) for name in names]
    sigma = np.array([np.hypot(meter.sigma, meter.step / np.sqrt(12.0)) for meter in meters])
    none, many = np.zeros(len(names)), np.full(len(names), np.inf)
    noise = NoiseModel(names, sigma, none, key["mount_m"], none, many, many, {})
    whitening = Whitening(unseen, noise)
    residual = beside_random((observations.value - predicted)[last], whitening) / sigma[unseen.channel]
    squares = [np.mean(residual[unseen.of(name)] ** 2) for name in names if unseen.of(name).any()]
    return float(np.sqrt(np.mean(squares)))


def comparison_lines(verdicts: Sequence[Verdict]) -> list[str]:
    """The table, in Markdown, and the methods that are not installed.

    Names are counted in the mean of the campaigns with one error. Errors are over the noise, in the run left out: the
    median, nine campaigns of ten, and the number of campaigns.
    """
    methods = [AS_DRAWN, FEMFIT, *installed()]
    head = ["", "nothing hidden: something found", "one error: something found", "truth among the names", "names"]
    head += [f"error, {what}" for what in ("nothing hidden", "one error", "cause without a name")]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for method in methods:
        by_kind = [
            [verdict for verdict in verdicts if verdict.method == method and verdict.hides == hides]
            for hides in (NOTHING, ONE, UNSEEN)
        ]
        nothing, single, _ = by_kind
        named = [
            _share([verdict.something for verdict in nothing]),
            _share([verdict.something for verdict in single]),
            _share([verdict.right for verdict in single]),
            f"{np.mean([verdict.names for verdict in single]):.1f}" if single else "",
        ]
        cells = [method, *(named if method != AS_DRAWN else [""] * 4), *map(_errors, by_kind)]
        lines.append(f"| {' | '.join(cells)} |")
    missing = [f"{name} ({package})" for name, (package, _) in METHODS.items() if name not in methods]
    return lines + [f"not installed, so not tried: {', '.join(missing)}"] * bool(missing)


def _share(hits: Sequence[bool]) -> str:
    share = Share(sum(hits), len(hits))
    low, high = share.ci95
    return f"{share.hits} of {share.of} ({100 * low:.0f} to {100 * high:.0f} %)"


def _errors(verdicts: Sequence[Verdict]) -> str:
    errors = [verdict.over_noise for verdict in verdicts if verdict.over_noise is not None]
    if not errors:
        return ""
    middle, most = np.quantile(errors, [0.5, 0.9])
    return f"{middle:.2f}, {most:.2f} ({len(errors)})"


def main():
    """Try all methods and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, nargs="+")
    parser.add_argument("--json", type=Path, help="file for what each method makes of each campaign")
    options = parser.parse_args()
    tables = {}
    for directory in options.directory:
        with progress(f"compare on {directory}", "campaigns") as show:
            verdicts = compare_methods(directory, show)
        tables[str(directory)] = [asdict(verdict) for verdict in verdicts]
        print("\n".join([f"{directory}:", *comparison_lines(verdicts), ""]), flush=True)
    if options.json:
        write_json(options.json, tables)


if __name__ == "__main__":
    main()
