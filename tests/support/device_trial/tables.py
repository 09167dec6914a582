"""The solved fields of a device's forms, at the settings of a bench and, for small steps beside them, between."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.load import read_actuator
from femfit.device.parts import Actuator
from femfit.field.sweep import run_sweep
from femfit.fit.build import fit_model
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model, write_model
from support.device_trial.drawings import FORMS, SETTINGS, write_drawing, write_model_drawing


@dataclass(frozen=True, eq=False)
class FormTable:
    """A form's field, at the settings of :data:`SETTINGS`."""

    # In N and Wb; shape (distances, currents)
    force: FloatArray
    flux_linkage: FloatArray
    resistance_ohm: float


@dataclass(frozen=True, eq=False)
class SolvedDevice:
    """A device with all its forms, and the model that a user would fit to the drawing."""

    name: str
    actuator: Actuator
    model: ActuatorModel
    forms: Mapping[str, FormTable]

    @property
    def settings(self) -> tuple[FloatArray, FloatArray]:
        """Distances in m and currents in A of the tables."""
        currents, distances = SETTINGS[self.name]
        return 1e-3 * np.array(distances), np.array(currents)


def solve_device(name: str, directory: Path, workers: int = 1) -> SolvedDevice:
    """Sweep a drawing and all its forms, or take up what was solved before."""
    actuator = read_actuator(write_model_drawing(name, directory))
    model_file = directory / f"{name}-model.json"
    if not model_file.exists():
        write_model(fit_model(run_sweep(actuator, directory / name, workers=workers)).model, model_file)
    forms = {form: _solved(name, form, directory, workers) for form in FORMS[name]}
    return SolvedDevice(name, actuator, read_model(model_file), forms)


def _solved(name: str, form: str, directory: Path, workers: int) -> FormTable:
    changed = read_actuator(write_drawing(name, form, directory))
    rows = run_sweep(changed, directory / f"{name}-{form}", workers=workers).rows
    currents, distances = SETTINGS[name]
    own = "" if len(changed.circuits) == 1 else f"_{changed.circuits[0].name}"
    rows = rows.sort_values(["distance_m", f"current{own}_A"])
    shape = (len(distances), len(currents))
    force, flux = (rows[column].to_numpy().reshape(shape) for column in ("force_N", f"flux_linkage{own}_Wb"))
    return FormTable(force, flux, changed.circuits[0].resistance_ohm)
