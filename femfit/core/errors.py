"""The errors that femfit raises on purpose.

::

    FemfitError
    ├── UsageError (ValueError)           an argument that no file makes right, such as a name that there is not
    │   └── ArgumentError (TypeError)     a keyword that a public function has not, or one that it needs
    ├── ActuatorFileError (ValueError)    an actuator .toml, every problem at once
    ├── FemFileError (ValueError)         a FEMM model that cannot become an actuator, every cause at once
    ├── TableError (ValueError)           a sweep, FEMM or bench table that cannot be used
    ├── ModelFileError (ValueError)       a model .json that cannot be read
    ├── DomainError (ValueError)          a point outside of a model's validity box
    ├── FitError (RuntimeError)           a fit that did not reach an optimum
    │   └── InfeasibleFitError            bounds and constraints that exclude every solution
    ├── FieldSolverError (RuntimeError)   a mesh or a field solution that failed
    ├── FilterError (ArithmeticError)     a filter that lost its covariance or its innovations
    ├── SimulationError (ArithmeticError) a motion that cannot be followed
    ├── RunDirectoryError (OSError)       a run directory that cannot be used or resumed
    ├── OutputError (OSError)             a result that would replace an input, or a file of another kind
    └── MissingPartError (LookupError)    a model without the part that a command needs

Each message says what was given, what is needed and what to do. ``femfit.cli`` is the one place that
catches :class:`FemfitError`.
"""

from collections.abc import Sequence


class FemfitError(Exception):
    """Base of all errors that femfit raises on purpose.

    Examples
    --------
    >>> import femfit as ff
    >>> try:
    ...     ff.read_model("nothing.json")
    ... except ff.FemfitError as error:
    ...     print(error)
    Model file nothing.json cannot be read: No such file or directory.
    """


class UsageError(FemfitError, ValueError):
    """An argument that is wrong whatever the files hold: an unknown name, a text that is not in its form."""


class ArgumentError(UsageError, TypeError):
    """A public function called with an argument that it has not, or without one that it needs."""


class _ProblemsError(ValueError):
    """A file with one or more problems, of which the message shows the first ones.

    Parameters
    ----------
    problems : sequence of str
        One line a problem: what was given, what is needed, what to do.
    """

    _SHOWN, _LONGEST = 20, 300  # Problems, and characters of one: chosen for a screen

    def __init__(self, source: str, problems: Sequence[str]) -> None:
        self.source = source
        self.problems = tuple(problems)
        cut = self._LONGEST
        lines = [line if len(line) <= cut else f"{line[:cut]}..." for line in self.problems[: self._SHOWN]]
        if len(self.problems) > self._SHOWN:
            lines.append(f"and {len(self.problems) - self._SHOWN} more, which may follow from these.")
        super().__init__("\n".join([self._head(), *(f"  - {line}" for line in lines)]))

    def _head(self) -> str:
        return f"{self.source} has {len(self.problems)} problem{'s' if len(self.problems) != 1 else ''}:"

    def __reduce__(self) -> tuple[type["_ProblemsError"], tuple[str, tuple[str, ...]]]:
        return type(self), (self.source, self.problems)


class ActuatorFileError(_ProblemsError, FemfitError):
    """An actuator file with one or more problems, each with its key path."""


class FemFileError(_ProblemsError, FemfitError):
    """A FEMM ``.fem`` file that cannot be read, or holds what an actuator file cannot say."""

    def _head(self) -> str:
        return f"{self.source} cannot be imported:"


class TableError(FemfitError, ValueError):
    """A sweep, FEMM or bench table that cannot be used."""


class ModelFileError(FemfitError, ValueError):
    """A model file that cannot be read."""


class DomainError(FemfitError, ValueError):
    """A point outside of a model's validity box."""


class FitError(FemfitError, RuntimeError):
    """A fit that did not reach an accepted optimum."""


class InfeasibleFitError(FitError):
    """Bounds and constraints that exclude every solution."""


class FieldSolverError(FemfitError, RuntimeError):
    """A mesh or a field solution that failed."""


class FilterError(FemfitError, ArithmeticError):
    """A filter whose covariance or innovations broke down."""


class SimulationError(FemfitError, ArithmeticError):
    """A motion in open loop that cannot be followed."""


class RunDirectoryError(FemfitError, OSError):
    """A run directory that cannot be used or resumed."""


class OutputError(FemfitError, OSError):
    """A result that would replace an input, or a file of another kind."""


class MissingPartError(FemfitError, LookupError):
    """A model without the part (circuit, motion, sensor) that a command needs."""
