"""Where cs2-identified takes the field of a current from: a lab record, a field model's file, or a swept model."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError, MissingPartError, TableError
from femfit.effects.conditions import Conditions
from femfit.integrate.constants import SWEPT_SHARE
from femfit.integrate.field_of_current import FieldModel, field_model_of_sweep
from femfit.integrate.identified_field import PATH_INTERVAL, LabRun, identify_field
from femfit.integrate.methods import IntegrationOptions, integrate_blocks, make_integrator
from femfit.integrate.uncertainty import SensingCoil
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.coil_record import open_coil_record


def identified_field(lab: str | Path, coil_area_m2: float) -> FieldModel:
    """Identify the field of a current from a record with a Hall probe, of a magnet that was cycled before."""
    record = open_coil_record(Path(lab))
    if not {"hall_T", "current_A"} <= set(record.columns):
        raise TableError(f"A lab record needs hall_T and current_A; {record.path} has {', '.join(record.columns)}.")
    blocks = record.blocks()
    first = next(blocks)
    integrator = make_integrator(IntegrationOptions("cs1-offset", SensingCoil(coil_area_m2)), first)
    step = max(1, round(PATH_INTERVAL / integrator.sample_time))
    parts: list[list[Any]] = [[], [], []]
    for block, out in integrate_blocks(integrator, itertools.chain([first], blocks)):
        rows = len(block) // step
        for part, column in zip(parts, (block.time, block.current, out.field), strict=True):
            if column is not None:
                part.append(column[: rows * step].reshape(rows, step).mean(axis=1))
    return identify_field([LabRun(*(np.concatenate(part) for part in parts))])


def swept_field(
    model: ActuatorModel, distance_m: float, *, of_flux: bool, sigma: float | None = None
) -> tuple[FieldModel, tuple[float, float]]:
    """The field of a current as a femfit model has it, with the moving part held.

    Parameters
    ----------
    of_flux : bool
        Whether the winding's flux linkage is meant, in Wb, and not the field at the Hall element, in T.
    sigma : float or None
        What the model is believed to be off by, in that unit; None is :data:`SWEPT_SHARE` of its largest.

    Returns
    -------
    model, currents : FieldModel, (float, float)
        And between which currents it holds, A.
    """
    sensor, domain = model.sensor, model.validity
    if sensor is None and not of_flux:
        raise MissingPartError(
            f"The field of a current is that at the Hall element, and {model.name} has none. Leave out --coil-area to "
            "compare flux linkages instead."
        )
    domain.require(np.array([distance_m]), np.array([domain.current_max_A]))
    if domain.current_max_A <= 0.0:
        raise DomainError(f"The model must reach a current > 0 A; {model.name} ends at {domain.current_max_A:g} A.")
    conditions = Conditions(nominal=nominal_of(model))

    def curve(current: FloatArray) -> FloatArray:
        read = predict_readings(model, np.full(current.shape, distance_m), current, conditions)
        if of_flux or sensor is None:
            return read["flux_linkage_Wb"]
        return np.asarray((read["hall_V"] - sensor.quiescent_V) / sensor.sensitivity_V_per_T)

    currents = (domain.current_min_A, domain.current_max_A)
    if sigma is None:
        sigma = SWEPT_SHARE * float(np.abs(curve(np.linspace(*currents, 33))).max())
    return field_model_of_sweep(curve, *currents, sigma), currents
