"""Fit results as JSON-ready data: for ``--json``, the model file's provenance and the report."""

from typing import Any

import numpy as np

from femfit.fit.coenergy import CoenergyFit
from femfit.fit.hall import HallFit
from femfit.fit.law_fit import LawFit
from femfit.fit.linearity import LinearityTest
from femfit.fit.ranking import TARGET, Ranking
from femfit.fit.rows import FitRows


def stage_one_data(fit: LawFit, rows: FitRows) -> list[dict[str, Any]]:
    """Stage one at each current, and what is left of it in the final law (Tables 3 and 5 of the paper).

    Returns
    -------
    list of dict
        J in N^2 of stage one and of the two-stage law, rms residual as a part of the force (its scale where it passes
        through zero) and of the weight (None where the part cannot hang), active bounds and condition numbers.
    """
    entries = []
    for i, coefficients, solution in zip(
        fit.stage_one.currents, fit.stage_one.coefficients, fit.stage_one.solutions, strict=True
    ):
        at = rows.current == i
        final = fit.force(fit.two_stage, rows.distance[at], rows.current[at]) - rows.force[at]
        entries.append(
            {
                "current_A": float(i),
                "coefficients": dict(zip(fit.law.basis, map(float, coefficients), strict=True)),
                "J_N2": float(np.sum(solution.residual**2)),
                "J_final_N2": float(np.sum(final**2)),
                "rms_of_force": _rms(solution.residual / rows.force_scale[at]),
                "rms_of_weight": None if rows.hanging_weight is None else _rms(solution.residual) / rows.hanging_weight,
                "active": {b: side for b, side in zip(fit.law.basis, solution.active, strict=True) if side},
                "condition": solution.condition,
                "condition_scaled": solution.condition_scaled,
            }
        )
    return entries


def law_data(fit: LawFit, rows: FitRows) -> dict[str, Any]:
    """A law's fit.

    Returns
    -------
    dict
        Coefficients, functions, sums of squares, intervals, active bounds and condition numbers.
    """
    two, joint = (fit.force(c, rows.distance, rows.current) for c in (fit.two_stage, fit.joint.x))
    return {
        "name": fit.law.name,
        "formula": fit.law.formula,
        "operations": fit.operations,
        "shape": dict(fit.shape),
        "shape_interval95": {name: list(ends) for name, ends in fit.shape_interval.items()},
        "stage_one": stage_one_data(fit, rows),
        "stage_two": [
            {
                "coefficient": basis,
                "function": function.name,
                "values": function.values.tolist(),
                "J3": function.residual_sum,
                "held_out_rms": dict(function.held_out),
                "active": list(function.active),
            }
            for basis, function in zip(fit.law.basis, fit.stage_two, strict=True)
        ],
        "terms": [
            {
                "column": basis,
                "current_power": power,
                "two_stage": float(fit.two_stage[n]),
                "joint": float(fit.joint.x[n]),
                "interval95_white": fit.interval.white[n].tolist(),
                "interval95_block": fit.interval.block[n].tolist(),
            }
            for n, (basis, power) in enumerate(fit.terms)
        ],
        "two_stage_rms_N": _rms(two - rows.force),
        "joint_rms_N": _rms(joint - rows.force),
        "two_stage_minus_joint_rms_N": _rms(two - joint),
        "joint_active": list(fit.limits.active(fit.joint)),
        "condition": fit.joint.condition,
        "condition_scaled": fit.joint.condition_scaled,
    }


def ranking_data(ranking: Ranking) -> dict[str, Any]:
    """A ranking of laws.

    Returns
    -------
    dict
        One entry a candidate, best first; null in place of what a law that could not be fitted does not have.
    """
    return {
        "of": ranking.of,
        "why_of": ranking.why_of or None,
        "target": TARGET,
        "recommended": ranking.recommended.law.name,
        "reached": ranking.reached,
        "candidates": [
            {
                "law": c.law.name,
                "formula": c.law.formula,
                "held_out_rms": c.held_out_rms if c.fit else None,
                "held_out_max": c.held_out_max if c.fit else None,
                "held_out_of_force": c.held_out_of_force if c.fit else None,
                "rms": c.rms if c.fit else None,
                "operations": c.fit.operations if c.fit else None,
                "parameters": c.parameters,
                "functions": list(c.fit.functions) if c.fit else None,
                "shape": dict(c.fit.shape) if c.fit else None,
                "active": list(c.fit.limits.active(c.fit.joint)) if c.fit else None,
                "condition": c.fit.joint.condition if c.fit else None,
                "condition_scaled": c.fit.joint.condition_scaled if c.fit else None,
                "failure": c.failure or None,
            }
            for c in ranking.candidates
        ],
    }


def coenergy_data(fit: CoenergyFit) -> dict[str, Any]:
    """A co-energy's fit.

    Returns
    -------
    dict
        Size, held-out error, constraints and condition numbers.
    """
    return {
        "coefficients": int(np.prod(fit.basis.shape)),
        "cells": list(fit.basis.cells),
        "current_degree": fit.basis.current_degree,
        "held_out_relative_rms": fit.held_out,
        "constraints": list(fit.constraints),
        "active": list(fit.active),
        "condition": fit.qp.condition,
        "condition_scaled": fit.qp.condition_scaled,
    }


def hall_data(fit: HallFit) -> dict[str, Any]:
    """A Hall characteristic's fit."""
    return {
        "coil_slope_T_per_A": list(fit.coil_slope_T_per_A),
        "magnet_field_T": list(fit.magnet_field_T),
        "rms_T": fit.rms_T,
        "max_T": fit.max_T,
        "held_out_of_range": fit.held_out,
        "coefficients": int(fit.field.spline.coefficients.size),
        "condition_scaled": fit.qp.condition_scaled,
    }


def linearity_data(test: LinearityTest) -> dict[str, Any]:
    """The linearity test.

    Returns
    -------
    dict
        Table 2 and the test of the quadratic part.
    """
    return {
        "pairs_A": test.pairs_A.tolist(),
        "mean_N": test.mean_N.tolist(),
        "sd_N": test.sd_N.tolist(),
        "spread_between_pairs": test.spread_between_pairs,
        "quadratic_share": test.quadratic_share,
        "quadratic_of_force": test.quadratic_of_force,
        "F": test.f_value,
        "p": test.p_value,
        "degrees_of_freedom": list(test.degrees_of_freedom),
    }


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
