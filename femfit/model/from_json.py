"""A model from JSON data, every value checked."""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from femfit.core.errors import ModelFileError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C
from femfit.effects.effect import AddedEffect
from femfit.laws.catalogue import law_by_name
from femfit.model.actuator_kind import ActuatorKind
from femfit.model.actuator_model import ActuatorModel, Circuit, HallSensor, Misfit, Motion, ValidityBox
from femfit.model.bspline import TensorSpline, is_clamped
from femfit.model.hall import HallSpline
from femfit.model.json_section import Section
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics, Magnetics
from femfit.model.to_json import SCHEMA_VERSION
from femfit.model.with_effects import with_effects


def model_from_dict(data: Mapping[str, Any], source: str = "model") -> ActuatorModel:
    """Build a model from JSON data.

    Parameters
    ----------
    data : mapping
        As written by :func:`model_to_dict`.

    Raises
    ------
    ModelFileError
        If the schema is newer than this femfit knows, or a key is missing, unknown or of the wrong kind.
    """
    version = data.get("schema") if isinstance(data, Mapping) else None
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise ModelFileError(f"{source} must be a femfit model file with a key 'schema' of 1 or more; it has none.")
    if version > SCHEMA_VERSION:
        raise ModelFileError(
            f"{source} has schema {version}; this femfit reads up to schema {SCHEMA_VERSION}. "
            "Update femfit, or write the model again with this version."
        )
    model = _build(Section(source, "", data))
    _check_values(model, source)
    return model


def _build(top: Section) -> ActuatorModel:
    top.refuse_others(("schema", *(f.name for f in fields(ActuatorModel) if f.name not in {"base", "dynamics"})))
    domain = _known(top.section("validity"), ValidityBox)
    circuit, motion = top.optional_section("circuit"), top.optional_section("motion")
    sensor, misfit = top.optional_section("sensor"), top.optional_section("misfit")
    kind = top.optional_section("kind")
    base = ActuatorModel(
        name=top.text("name"),
        magnetics=_magnetics_from(top.section("magnetics")),
        validity=ValidityBox(**{f.name: domain.number(f.name) for f in fields(ValidityBox)}),
        circuit=_circuit_from(_known(circuit, Circuit)) if circuit else None,
        motion=_motion_from(_known(motion, Motion)) if motion else None,
        sensor=_sensor_from(_known(sensor, HallSensor)) if sensor else None,
        misfit=_misfit_from(_known(misfit, Misfit)) if misfit else None,
        sample_time_s=top.number("sample_time_s", positive=True),
        reference_distances_m=tuple(top.array("reference_distances_m", 1).tolist()),
        covariance=None if top.data.get("covariance") is None else top.array("covariance", 2),
        provenance=dict(top.section("provenance").data),
        coil_temperature_C=_temperature(top, "coil_temperature_C"),
        magnet_temperature_C=_temperature(top, "magnet_temperature_C"),
        kind=_kind_from(_known(kind, ActuatorKind)) if kind else None,
    )
    added = top.sections("effects") if top.data.get("effects") else ()
    return with_effects(base, [_effect_from(section) for section in added])


def _temperature(top: Section, key: str) -> float:
    """Absent in files from before effects could be added: the reference."""
    return top.number(key) if key in top.data else REFERENCE_TEMPERATURE_C


def _effect_from(section: Section) -> AddedEffect:
    section.refuse_others(("name", "parameters", "ci95"))
    effect = effect_by_name(section.text("name"))
    names = tuple(p.name for p in effect.parameters)
    parameters, intervals = section.section("parameters"), section.section("ci95")
    parameters.refuse_others(names)
    intervals.refuse_others(names)
    pairs = {name: intervals.array(name, 1) for name in names if name in intervals.data}
    for name, pair in pairs.items():
        if len(pair) != 2:
            raise intervals.refusal(name, "a pair of numbers")
    return AddedEffect(
        effect=effect,
        parameters={name: parameters.number(name) for name in names},
        ci95={name: (float(pair[0]), float(pair[1])) for name, pair in pairs.items()},
    )


def _known(section: Section, kind: type[Any]) -> Section:
    section.refuse_others(tuple(f.name for f in fields(kind)))
    return section


def _circuit_from(section: Section) -> Circuit:
    low = section.number("voltage_min_V")
    return Circuit(section.number("resistance_ohm", positive=True), low, section.number("voltage_max_V", lower=low))


def _motion_from(section: Section) -> Motion:
    return Motion(section.number("mass_kg", positive=True), section.number("gravity_m_s2"))


def _kind_from(section: Section) -> ActuatorKind:
    return ActuatorKind(**{f.name: section.truth(f.name) for f in fields(ActuatorKind)})


def _sensor_from(section: Section) -> HallSensor:
    low = section.number("output_min_V")
    return HallSensor(
        field=HallSpline(*_spline_from(section.section("field"))),
        sensitivity_V_per_T=section.number("sensitivity_V_per_T"),
        quiescent_V=section.number("quiescent_V"),
        output_min_V=low,
        output_max_V=section.number("output_max_V", lower=low),
        adc_bits=section.integer("adc_bits", 0, 64),
        noise_V=section.number("noise_V", lower=0.0),
    )


def _misfit_from(section: Section) -> Misfit:
    return Misfit(
        force_rms_N=section.number("force_rms_N"),
        force_max_N=section.number("force_max_N"),
        force_rms_relative=section.number("force_rms_relative"),
        force_rms_of_weight=section.optional_number("force_rms_of_weight"),
        flux_linkage_rms_Wb=section.optional_number("flux_linkage_rms_Wb"),
        inductance_rms_H=section.optional_number("inductance_rms_H"),
        force_share=section.optional_number("force_share"),
        flux_linkage_share=section.optional_number("flux_linkage_share"),
        inductance_share=section.optional_number("inductance_share"),
        hall_rms_T=section.optional_number("hall_rms_T"),
        rows=section.integer("rows", 0, 2**53),
        against=section.text("against"),
    )


def _check_values(model: ActuatorModel, source: str) -> None:
    """Refuse a domain that is none, and fields that are not finite in it (in 25 points)."""
    domain = model.validity
    if not (0 < domain.distance_min_m < domain.distance_max_m and domain.current_min_A <= domain.current_max_A):
        raise ModelFileError(
            f"{source} is damaged: validity must span distances > 0 and currents in ascending order; instead received "
            f"{domain}. Write it again with femfit fit."
        )
    d, i = np.meshgrid(
        np.linspace(domain.distance_min_m, domain.distance_max_m, 5),
        np.linspace(domain.current_min_A, domain.current_max_A, 5),
    )
    # Coefficients near the largest float overflow here instead of in a filter
    with np.errstate(all="ignore"):
        state = model.magnetics.state(d, i)
        values = [state.force, state.motional_constant, state.inductance]
        if model.sensor is not None:
            values.append(model.sensor.voltage(d, i))
    if not np.all(np.isfinite(values)):
        raise ModelFileError(
            f"{source} is damaged: force, inductance or Hall voltage is not finite everywhere in the validity domain. "
            "Write it again with femfit fit."
        )


def _magnetics_from(section: Section) -> Magnetics:
    kind = section.text("kind")
    if kind == "coenergy_spline":
        return CoenergySpline(*_spline_from(section))
    if kind != "law":
        raise section.refusal("kind", "coenergy_spline or law")
    law = law_by_name(section.text("law"))
    section.section("shape").refuse_others(tuple(p.name for p in law.shape))
    return LawMagnetics(
        law_name=law.name,
        coefficients=tuple(_coefficient_from(item, law.basis) for item in section.sections("coefficients")),
        shape={p.name: section.section("shape").number(p.name) for p in law.shape},
        constant_inductance_H=section.number("constant_inductance_H"),
        constant_flux_linkage_Wb=section.number("constant_flux_linkage_Wb"),
        reference_distance_m=section.optional_number("reference_distance_m"),
    )


def _coefficient_from(section: Section, basis: tuple[str, ...]) -> Coefficient:
    if section.text("basis") not in basis:
        raise section.refusal("basis", f"a column of the law ({', '.join(basis)})")
    interval = None if section.data.get("ci95") is None else section.array("ci95", 1)
    bounds = section.data.get("bounds")
    if not isinstance(bounds, list) or len(bounds) != 2 or (interval is not None and len(interval) != 2):
        raise section.refusal("bounds", "a pair, as ci95, with null for a bound that is none")
    ends = Section(section.source, section.where("bounds"), dict(zip(("lower", "upper"), bounds, strict=True)))
    lower, upper = ends.optional_number("lower"), ends.optional_number("upper")
    return Coefficient(
        basis=section.text("basis"),
        current_power=section.integer("current_power", 0, 16),
        value=section.number("value"),
        unit=section.text("unit"),
        ci95=None if interval is None else (float(interval[0]), float(interval[1])),
        bounds=(-math.inf if lower is None else lower, math.inf if upper is None else upper),
        active=section.text("active"),
    )


def _spline_from(section: Section) -> tuple[float, TensorSpline, float]:
    """d_0, spline and shift of a co-energy or a Hall field."""
    spline = TensorSpline(
        x_knots=section.array("u_knots", 1),
        y_knots=section.array("current_knots_A", 1),
        x_degree=section.integer("u_degree", 1, 9),
        y_degree=section.integer("current_degree", 1, 9),
        coefficients=section.array("coefficients", 2),
    )
    for key, knots, degree in (
        ("u_knots", spline.x_knots, spline.x_degree),
        ("current_knots_A", spline.y_knots, spline.y_degree),
    ):
        if not is_clamped(knots, degree):
            raise section.refusal(key, f"ascending, with {degree + 1} equal knots at both ends and fewer inside")
    needed = (len(spline.x_knots) - spline.x_degree - 1, len(spline.y_knots) - spline.y_degree - 1)
    if spline.coefficients.shape != needed:
        raise section.refusal("coefficients", f"{needed[0]} lists of {needed[1]} numbers, as the knots ask for")
    # Absent in files from before the shift: they have none.
    shift = section.number("distance_shift_m", lower=0.0) if "distance_shift_m" in section.data else 0.0
    return section.number("reference_distance_m", positive=True), spline, shift
