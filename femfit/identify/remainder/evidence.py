"""Which parts a remainder has, and how large and how smooth each is: by the restricted likelihood of penalised splines.

Whitened readings y = X beta + noise, with beta ~ N(0, t^2 K) in each part. K is the correlation of a smooth function,
so that 1 / t^2 is the penalty on what is large or rough. With Phi = X t K^(1/2) of all parts together and the
likelihood without any of them as the unit,

    log p = (z'z - log det(I + Phi'Phi)) / 2,    z = (I + Phi'Phi)^(-1/2) Phi'y.

Nothing beside the penalised coefficients is fitted, so that restricted likelihood and likelihood are one.

References
----------
S. N. Wood, Journal of the Royal Statistical Society B 73 (2011) 3: smoothing by restricted likelihood.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import linalg, optimize

from femfit.core.numerics import BoolArray, FloatArray
from femfit.identify.remainder.constants import BEGUN, LEAST_SHARE, PRICE, SIZES


@dataclass(frozen=True, eq=False)
class Gram:
    """Products of all parts' whitened columns: all that the choice needs of the readings."""

    products: FloatArray  # X'X, shape (k, k)
    target: FloatArray  # X'y, shape (k,)
    parts: tuple[slice, ...]  # Where each part's columns stand

    @classmethod
    def of(cls, columns: Sequence[FloatArray], target: FloatArray) -> "Gram":
        """From the whitened columns of each part and the whitened readings."""
        ends = np.cumsum([0, *(block.shape[1] for block in columns)])
        every = np.concatenate(columns, axis=1)
        slices = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
        return cls(every.T @ every, every.T @ target, slices)

    def beside(self, number: int, roots: Mapping[int, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """X'X and X'y of a part beside others that are known to N(0, L L'), given their roots L."""
        place = self.parts[number]
        products, target = self.products[place, place], self.target[place]
        rest = {k: root for k, root in roots.items() if k != number}
        if not rest:
            return products, target
        where = np.concatenate([np.arange(self.parts[k].start, self.parts[k].stop) for k in rest])
        root = linalg.block_diag(*rest.values())
        factor = linalg.cho_factor(np.eye(len(where)) + root.T @ self.products[np.ix_(where, where)] @ root)
        cross = self.products[place][:, where] @ root
        return (
            products - cross @ linalg.cho_solve(factor, cross.T),
            target - cross @ linalg.cho_solve(factor, root.T @ self.target[where]),
        )


def sets_that_pay(gram: Gram, roots: Sequence[Sequence[FloatArray]]) -> list[dict[int, FloatArray]]:
    """Sets of parts, begun with each part that says much by itself, each part with the root of its prior covariance."""
    alone = {k: _best_root(*gram.beside(k, {}), of_part) for k, of_part in enumerate(roots)}
    most = max((gain for _, gain in alone.values()), default=0.0)
    if most < PRICE:
        return []
    begun = [k for k, (_, gain) in alone.items() if gain >= max(PRICE, BEGUN * most)]
    sets = {frozenset(chosen): chosen for chosen in (_grown(gram, roots, {k: alone[k][0]}) for k in begun)}
    return list(sets.values())


def _grown(gram: Gram, roots: Sequence[Sequence[FloatArray]], first: Mapping[int, FloatArray]) -> dict[int, FloatArray]:
    """Add the part that adds most evidence, size each anew beside the others, and drop what no longer pays."""
    chosen, tried, total = dict(first), set(first), evidence(gram, first)
    while len(tried) < len(roots):
        candidates = {k: _best_root(*gram.beside(k, chosen), roots[k]) for k in range(len(roots)) if k not in tried}
        best = max(candidates, key=lambda k: candidates[k][1])
        if candidates[best][1] < max(PRICE, LEAST_SHARE * total):
            break
        tried.add(best)
        chosen = sized_anew(gram, roots, {**chosen, best: candidates[best][0]})
        total = evidence(gram, chosen)
    return chosen


def sized_anew(
    gram: Gram, roots: Sequence[Sequence[FloatArray]], chosen: Mapping[int, FloatArray]
) -> dict[int, FloatArray]:
    """Each part's size and smoothness beside the others; without those that no longer pay."""
    result = dict(chosen)
    for _ in range(2):
        for k in tuple(result):
            root, gain = _best_root(*gram.beside(k, result), roots[k])
            if gain < PRICE:
                del result[k]
            else:
                result[k] = root
    return result


def _best_root(products: FloatArray, target: FloatArray, roots: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """The root of the prior covariance of largest likelihood, and the log of that over the one without the part."""
    best = np.zeros_like(products), 0.0
    for root in roots:
        values, vectors = np.linalg.eigh(root.T @ products @ root)
        values = np.maximum(values, 0.0)
        if not values[-1] > 0.0:
            continue
        along = (vectors.T @ (root.T @ target)) ** 2
        sizes = np.geomspace(0.1, 1e4, SIZES) / np.sqrt(values[-1])
        grown = sizes[:, None] ** 2 * values
        gains = 0.5 * np.sum(sizes[:, None] ** 2 * along / (1.0 + grown) - np.log1p(grown), axis=1)
        k = int(np.argmax(gains))
        if gains[k] > best[1]:
            best = sizes[k] * root, float(gains[k])
    return best


def evidence(gram: Gram, chosen: Mapping[int, FloatArray]) -> float:
    """Log of the likelihood with parts over that without any."""
    if not chosen:
        return 0.0
    where, root = _joined(gram, chosen)
    factor = np.linalg.cholesky(np.eye(len(where)) + root.T @ gram.products[np.ix_(where, where)] @ root)
    z = linalg.solve_triangular(factor, root.T @ gram.target[where], lower=True)
    return float(0.5 * z @ z - np.sum(np.log(np.diag(factor))))


def complexity(gram: Gram, chosen: Mapping[int, FloatArray]) -> float:
    """Log det(I + Phi'Phi): what the parts' freedom costs of twice the log of the likelihood."""
    where, root = _joined(gram, chosen)
    inner = np.eye(len(where)) + root.T @ gram.products[np.ix_(where, where)] @ root
    return float(np.linalg.slogdet(inner)[1])


@dataclass(frozen=True, eq=False)
class Posterior:
    """What the readings say of the coefficients."""

    mean: Mapping[int, FloatArray]
    covariance: FloatArray  # Of all of them, in the order of ``mean``


def posterior(gram: Gram, chosen: Mapping[int, FloatArray], not_negative: Mapping[int, BoolArray]) -> Posterior:
    """Mean and covariance of the coefficients of the chosen parts, some of them bounded from below by zero."""
    where, root = _joined(gram, chosen)
    products = gram.products[np.ix_(where, where)]
    inner = np.eye(len(where)) + root.T @ products @ root
    factor = linalg.cho_factor(inner)
    mean = root @ linalg.cho_solve(factor, root.T @ gram.target[where])
    bounded = np.concatenate([not_negative.get(k, np.zeros(r.shape[0], bool)) for k, r in chosen.items()])
    if np.any(mean[bounded] < 0.0):
        upper = np.linalg.cholesky(inner).T @ np.linalg.inv(root)
        solved = optimize.lsq_linear(upper, upper @ mean, bounds=(np.where(bounded, 0.0, -np.inf), np.inf))
        mean = np.maximum(solved.x, np.where(bounded, 0.0, -np.inf))
    ends = np.cumsum([r.shape[0] for r in chosen.values()])[:-1]
    parts = dict(zip(chosen, np.split(mean, ends), strict=True))
    return Posterior(parts, root @ linalg.cho_solve(factor, root.T))


def _joined(gram: Gram, chosen: Mapping[int, FloatArray]) -> tuple[FloatArray, FloatArray]:
    where = np.concatenate([np.arange(gram.parts[k].start, gram.parts[k].stop) for k in chosen])
    return where, np.asarray(linalg.block_diag(*chosen.values()))
