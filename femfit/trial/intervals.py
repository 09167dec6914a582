"""How sure a share is that was counted in a few hundred cases.

References
----------
C. J. Clopper and E. S. Pearson, Biometrika 26 (1934) 404: exact limits of a binomial proportion.
"""

from dataclasses import dataclass

from scipy import stats


@dataclass(frozen=True)
class Share:
    """A counted share."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        """Hits over cases; NaN where there are none."""
        return self.hits / self.of if self.of else float("nan")

    @property
    def ci95(self) -> tuple[float, float]:
        """Exact 95 % limits; 0 and 1 where there are no cases."""
        low = float(stats.beta.ppf(0.025, self.hits, self.of - self.hits + 1)) if self.hits else 0.0
        high = float(stats.beta.ppf(0.975, self.hits + 1, self.of - self.hits)) if self.hits < self.of else 1.0
        return low, high
