"""Where ``femfit integrate`` takes the field of a current from: a lab record, a file, or a swept model."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError, MissingPartError, TableError
from femfit.effects.conditions import Conditions
from femfit.fit.hysteresis import PATH_INTERVAL, LabRun, identify_field
from femfit.integrate.methods import IntegrationOptions, integrate_blocks, make_integrator
from femfit.integrate.uncertainty import SensingCoil
from femfit.model.field_of_current import FieldModel, field_model_of_sweep, read_field_model, write_field_model
from femfit.model.json_file import read_model
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.coil_record import CoilRecord, open_coil_record

SWEPT_SHARE = 0.01
"""Of its largest field that a swept model is believed to be off by where nothing else is said."""


def identified_field(coil: SensingCoil, lab: Path | None, path: Path | None) -> FieldModel:
    """The field model of cs2-identified: identified from a lab record, or read.

    Parameters
    ----------
    coil : SensingCoil
        Of the lab record.
    lab : Path or None
        Lab record with Hall probe and current.
    path : Path or None
        Field model's file: written with a lab record, read without.

    Returns
    -------
    FieldModel
        The model.

    Raises
    ------
    TableError
        If neither is given, or the lab record lacks a column.
    """
    if lab is None:
        if path is None:
            raise TableError(
                "cs2-identified needs what field belongs to a current: give --lab RECORD (with hall_T and current_A, "
                "of a magnet that was cycled before), --field-model FILE, or --model MODEL.json with --distance-mm."
            )
        return read_field_model(path)
    model = identify_field([_lab_run(open_coil_record(lab), IntegrationOptions("cs1-offset", coil))])
    if path is not None:
        write_field_model(model, path)
    return model


def swept_field(
    path: Path, distance: float, of_flux: bool, sigma: float | None
) -> tuple[FieldModel, tuple[float, float]]:
    """The field of a current as a femfit model has it, with the moving part held.

    Parameters
    ----------
    path : Path
        Model file.
    distance : float
        Of the moving part, m.
    of_flux : bool
        Whether the winding's flux linkage is meant, in Wb, and not the field at the Hall element, in T.
    sigma : float or None
        What the model is believed to be off by, in that unit; None is :data:`SWEPT_SHARE` of its largest.

    Returns
    -------
    model, currents : FieldModel, (float, float)
        And between which currents it holds, A.

    Raises
    ------
    DomainError
        If the model does not reach the distance, or no current above zero.
    MissingPartError
        If the field is meant and the model has no Hall element.
    """
    model = read_model(path)
    sensor, box = model.sensor, model.validity
    if sensor is None and not of_flux:
        raise MissingPartError(
            f"The field of a current is that at the Hall element, and {path} has none. Leave out --coil-area to "
            "compare flux linkages instead."
        )
    box.require(np.array([distance]), np.array([box.current_max_A]))
    if box.current_max_A <= 0.0:
        raise DomainError(f"The model must reach a current > 0 A; {path} ends at {box.current_max_A:g} A.")
    at = Conditions(nominal=nominal_of(model))

    def curve(current: FloatArray) -> FloatArray:
        read = predict_readings(model, np.full(current.shape, distance), current, at)
        if of_flux or sensor is None:
            return read["flux_linkage_Wb"]
        return np.asarray((read["hall_V"] - sensor.quiescent_V) / sensor.sensitivity_V_per_T)

    currents = (box.current_min_A, box.current_max_A)
    if sigma is None:
        sigma = SWEPT_SHARE * float(np.abs(curve(np.linspace(*currents, 33))).max())
    return field_model_of_sweep(curve, *currents, sigma), currents


def _lab_run(record: CoilRecord, options: IntegrationOptions) -> LabRun:
    """A lab record, thinned to the steps of the identification while it streams."""
    if not {"hall_T", "current_A"} <= set(record.columns):
        raise TableError(f"A lab record needs hall_T and current_A; {record.path} has {', '.join(record.columns)}.")
    blocks = record.blocks()
    first = next(blocks)
    integrator = make_integrator(options, first)
    step = max(1, round(PATH_INTERVAL / integrator.sample_time))
    parts: list[list[Any]] = [[], [], []]
    for block, out in integrate_blocks(integrator, itertools.chain([first], blocks)):
        if block.current is None:
            continue
        rows = len(block) // step
        for part, column in zip(parts, (block.time, block.current, out.field), strict=True):
            part.append(column[: rows * step].reshape(rows, step).mean(axis=1))
    return LabRun(*(np.concatenate(part) for part in parts))
