"""Runs femfit's diagnosis on a case's files, as ``femfit diagnose`` and ``femfit add`` would."""

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import FemfitError
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.place import placed
from femfit.identify.refit.add_effects import add_effects
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.tables.measurement import BenchTable, Measurement
from femfit.tables.measurement_file import read_measurement


@dataclass(frozen=True, eq=False)
class CaseFiles:
    """What an engine may read of a case."""

    model: ActuatorModel
    data: Measurement
    unseen: Measurement

    @property
    def observations(self) -> Observations:
        """The campaign beside the model."""
        return placed(self.model, self.data)


def read_case(directory: Path) -> CaseFiles:
    """Read a case's files, as the commands do."""
    return CaseFiles(
        read_model(directory / "model.json"),
        read_measurement(directory / "data.csv"),
        read_measurement(directory / "unseen.csv"),
    )


def diagnose_case(files: CaseFiles, exclude: tuple[str, ...] = ()) -> dict[str, Any]:
    """Diagnose a case."""
    start = perf_counter()
    try:
        result = diagnose(files.model, files.data, exclude=exclude, bootstrap=0).to_dict()
    except FemfitError as error:
        result = {"verdict": "error", "missing": [], "where": {"channel": "", "covariates": []}, "message": str(error)}
    return {**result, "seconds": perf_counter() - start}


def unseen_rms(files: CaseFiles, names: tuple[str, ...]) -> dict[str, float]:
    """Error on the run that was kept back, after effects were added.

    Returns
    -------
    dict of str to float
        Root mean square per channel, re-mounts included; empty for a time series, whose balances have no floor of their
        own.
    """
    if not isinstance(files.data, BenchTable):
        return {}
    model = add_effects(files.model, files.data, names).model if names else files.model
    both = pd.concat([files.data.rows, files.unseen.rows], ignore_index=True)
    observations = placed(model, replace(files.data, rows=both))
    last = observations.column("run") == observations.covariates["run"].max()
    residual = observations.residual
    return {
        name: float(np.sqrt(np.mean(residual[last & observations.of(name)] ** 2))) for name in observations.channels
    }
