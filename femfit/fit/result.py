"""What a fit gives: the model, how it came about, and both as text and JSON-ready data."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.results import Plotted, Result
from femfit.fit.circuits_fit import CircuitsFit
from femfit.fit.coenergy import SHAPES, CoenergyFit
from femfit.fit.constants import DOMAIN_GRID
from femfit.fit.law_fit import LawFit
from femfit.fit.ranking import Ranking
from femfit.fit.rows import FitRows, rms
from femfit.fit.sensed_field import HallFit
from femfit.fit.words import printed
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import Magnetics
from femfit.model.several_magnetics import NETWORK, OPERATIONS
from femfit.model.validity import Misfit

if TYPE_CHECKING:
    from femfit.fit.soft_iron import NetworkFit


@dataclass(frozen=True, eq=False, kw_only=True)
class Fits:
    """What was fitted: of one circuit a co-energy and perhaps a law in its place, or the co-energy of several."""

    coenergy: CoenergyFit | None = None
    law: LawFit | None = None
    ranking: Ranking | None = None
    network: "NetworkFit | None" = None
    circuits: CircuitsFit | None = None

    @property
    def spline(self) -> CoenergyFit | None:
        """The co-energy of one circuit where it is the model itself."""
        return None if self.law or self.network else self.coenergy

    def magnetics(self, inductance_H: float | None) -> Magnetics:
        """The law's, the network's or the co-energy's."""
        if self.law is not None:
            return self.law.magnetics(inductance_H)
        fit = self.network or self.circuits or self.coenergy
        assert fit is not None  # noqa: S101  a co-energy that is needed raises
        return fit.magnetics


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FitResult(Plotted, Result, Fits):
    """A model and how it came about.

    Parameters
    ----------
    model : ActuatorModel
        Its ``misfit`` is that of its file, read back, to the table.
    coenergy : CoenergyFit or None
        The model itself where no law was asked for; None where the table is too small for one.
    law : LawFit or None
        The law, where one was asked for or recommended.
    ranking : Ranking or None
        Where all laws were asked for.
    hall : HallFit or None
        Where the table has the field at a Hall element.
    notes : tuple of str
        What the model lacks, and how to give it.
    of_data : tuple of str
        What the table's import warned of.
    network : NetworkFit or None
        The law of a plunger that saturates, where it was asked for or is better than every other law.
    circuits : CircuitsFit or None
        The co-energy of several circuits.

    Examples
    --------
    >>> import femfit as ff
    >>> print(ff.fit_model("runs/rig"))
    emaws-rig: the co-energy misses the force by ... % rms at the 50 points of its table; valid from ...
    """

    finite = True

    model: ActuatorModel
    hall: HallFit | None
    rows: FitRows
    notes: tuple[str, ...]
    of_data: tuple[str, ...] = ()

    @property
    def misfit(self) -> Misfit:
        """The misfit of the model as it is written, to its table."""
        assert self.model.misfit is not None  # noqa: S101  every fit computes it
        return self.model.misfit

    def __str__(self) -> str:
        """The lines that ``femfit fit`` prints, the answer first."""
        derived = None if self.circuits or self.rows.without_current else self._ranges()
        return printed("fit.txt.j2", result=self, derived=derived, shapes=SHAPES)

    def _ranges(self) -> dict[str, tuple[float, float] | None]:
        """Motional constant and inductance over all of the domain, where they are known."""
        state = self.model.magnetics.state(*self.model.validity.grid(*DOMAIN_GRID))
        constant, inductance = ((np.min(x), np.max(x)) for x in (state.motional_constant, state.inductance))
        known = self.model.circuit is not None or self.rows.flux_linkage is not None
        return {"motional_constant": constant, "inductance": inductance if known else None}

    @property
    def data(self) -> dict[str, Any]:
        """What programs read, in the model's provenance, too."""
        between = self.misfit.between
        return {
            "model": self.law.law.name if self.law else NETWORK if self.network else "coenergy",
            "rows": len(self.rows.force),
            "misfit": self.misfit,
            "coenergy": _coenergy_data(self.coenergy) if self.coenergy else None,
            "law": _law_data(self.law) if self.law else None,
            "network": {"operations": OPERATIONS, "left_out_of_rms": self.network.left_out} if self.network else None,
            "circuits": self.circuits.magnetics.names if self.circuits else None,
            "ranking": self.ranking,
            "hall": self.hall,
            "finer_sweep": between and {"distance_m": between.finer_distance_m, "current_A": between.finer_current_A},
            "notes": [*self.of_data, *self.notes],
        }


def _coenergy_data(fit: CoenergyFit) -> dict[str, Any]:
    return {
        "coefficients": fit.basis.size,
        "cells": [fit.basis.u_cells, *fit.basis.functions.cells],
        "current_degree": fit.basis.functions.degrees[0],
        "held_out_relative_rms": fit.held_out,
        "left_out_force_rms_N": rms(fit.left_out["force"]),
        "constraints": fit.constraints,
        "active": fit.active,
        "condition_scaled": fit.qp.condition_scaled,
    }


def _law_data(fit: LawFit) -> dict[str, Any]:
    return {
        "name": fit.law.name,
        "formula": fit.law.formula,
        "operations": fit.operations,
        "shape": fit.shape,
        "shape_interval95": fit.shape_interval,
        "functions": dict(zip(fit.law.basis, fit.functions, strict=True)),
        "terms": [
            {"column": c.basis, "current_power": c.current_power, "value": c.value, "interval95": interval}
            for c, interval in zip(fit.coefficients, fit.interval.tolist(), strict=True)
        ],
        "active": fit.active,
        "condition_scaled": fit.joint.condition_scaled,
    }
