"""Effects that carry their own data, in a model file.

Numbers of the drawing, with what they change, in a model file.
"""

from typing import Any

from femfit.effects.effect import Effect, EffectParameter
from femfit.model.bspline import LINE, PARABOLA, TensorSpline
from femfit.model.carried import (
    Brake,
    Carried,
    Conductivity,
    Curve,
    FieldChange,
    FieldTerm,
    FurtherResistance,
    ReadingChange,
    SettingChange,
    carried_effect,
)
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect, parameter_name
from femfit.model.impedance import ImpedanceChange
from femfit.model.json_magnetics import (
    COORDINATE_KEYS,
    coordinate_from,
    coordinate_to,
    knots_from,
    spline_from,
    spline_to,
)
from femfit.model.json_section import Section, plain

_TEXTS = ("symptom", "experiment", "reference")
_MAGNETICS, _BRAKE, _RESISTANCE, _IMPEDANCE = "magnetics", "brake", "resistance", "impedance"
_CONDUCTIVITY = "conductivity"
_OF_CIRCUITS = 3, 5  # Dimensions: of one circuit in older files, and with the circuits last
_AXES = "u", "current", "log_frequency"
_CURVES = "setting", "readings", "branches"


def carried_to(effect: Effect) -> dict[str, Any]:
    """What an effect carries, as JSON-ready data."""
    carried = effect.carried
    assert isinstance(carried, Carried)  # noqa: S101  the model file asks for such effects alone
    setting, readings, brake, resistance = carried.setting, carried.readings, carried.brake, carried.resistance
    stages = {
        _MAGNETICS: carried.magnetics and [term_to(term) for term in carried.magnetics.terms],
        "setting": setting and {key: curve for key, curve in vars(setting).items() if curve is not None},
        "readings": readings and (readings.channels or None),
        "branches": readings and (readings.branches or None),
        _BRAKE: brake and {"rounded_m_s": brake.rounded_m_s, "against": brake.against},
        _RESISTANCE: resistance and resistance.over,
        _IMPEDANCE: carried.impedance and impedance_to(carried.impedance),
        _CONDUCTIVITY: carried.conductivity,
        "notes": carried.notes or None,
    }
    texts = {key: getattr(effect, key) for key in _TEXTS}
    given = {key: plain(stage) for key, stage in stages.items() if stage is not None}
    return {**texts, "parameters": plain(effect.parameters), **given}


def carried_from(name: str, section: Section) -> Effect:
    """The effect of a name with what it carries."""
    stages = _BRAKE, _RESISTANCE, _IMPEDANCE, _CONDUCTIVITY, "notes"
    section.refuse_others((*_TEXTS, "parameters", _MAGNETICS, *_CURVES, *stages))
    parameters = tuple(one.record(EffectParameter) for one in section.sections("parameters"))
    known = {p.name for p in parameters}
    terms = section.sections(_MAGNETICS) if section.data.get(_MAGNETICS) else ()
    curves = {key: _curves_from(section.optional_section(key), known) for key in _CURVES}
    brake, resistance, impedance, conductivity, notes = (section.optional_section(key) for key in stages)
    if (setting := section.optional_section("setting")) is not None:
        setting.refuse_others(("distance_m", "current_A"))
    read = curves["readings"], curves["branches"]
    carried = Carried(
        magnetics=FieldChange(tuple(term_from(one, known) for one in terms)) if terms else None,
        setting=SettingChange(**curves["setting"]) if curves["setting"] else None,
        readings=ReadingChange(*read) if any(read) else None,
        brake=_brake_from(brake, known) if brake else None,
        resistance=FurtherResistance(_curve_from(resistance, known)) if resistance else None,
        impedance=impedance_from(impedance, known) if impedance else None,
        conductivity=Conductivity(_parameter_of(conductivity, known)) if conductivity else None,
        notes={key: notes.text(key) for key in notes.data} if notes else None,
    )
    texts = {key: section.text(key) for key in _TEXTS}
    return carried_effect(name, texts.pop("symptom"), parameters, carried, **texts)


def term_to(term: FieldTerm) -> dict[str, Any]:
    """What a parameter changes of the fields, as JSON-ready data."""
    splines = {"coenergy_J": term.coenergy, "hall_T": term.hall}
    written = {key: spline_to(term.coordinate, one) for key, one in splines.items() if one is not None}
    kind = {"power": term.power} | ({"reciprocal": True} if term.reciprocal else {})
    return {"parameter": term.parameter, **kind, **written}


def term_from(section: Section, parameters: set[str]) -> FieldTerm:
    """What :func:`term_to` wrote, of one of some parameters."""
    section.refuse_others(("parameter", "power", "reciprocal", "coenergy_J", "hall_T"))
    found: dict[str, tuple[DistanceCoordinate, TensorSpline]] = {
        key: spline_from(section.section(key), beyond)
        for key, beyond in (("coenergy_J", PARABOLA), ("hall_T", LINE))
        if key in section.data
    }
    coordinates = {coordinate for coordinate, _ in found.values()}
    if len(coordinates) != 1:
        raise section.refusal("coenergy_J", "a spline, in the same coordinate as hall_T where both are there")
    splines = {key: spline for key, (_, spline) in found.items()}
    return FieldTerm(
        parameter=_parameter_of(section, parameters),
        coordinate=coordinates.pop(),
        coenergy=splines.get("coenergy_J"),
        hall=splines.get("hall_T"),
        power=section.integer("power", 1, 9),
        reciprocal="reciprocal" in section.data and section.truth("reciprocal"),
    )


def impedance_to(change: ImpedanceChange) -> dict[str, Any]:
    """What a parameter changes of an impedance, as JSON-ready data."""
    axes = zip(_AXES, change.knots, change.degrees, strict=True)
    return {
        "parameter": change.parameter,
        "share": change.share,
        **coordinate_to(change.coordinate),
        **{name: {"knots": knots.tolist(), "degree": degree} for name, knots, degree in axes},
        "real_H": change.coefficients.real.tolist(),
        "imaginary_H": change.coefficients.imag.tolist(),
        **({} if change.bend is None else {"bend_H": [change.bend.real.tolist(), change.bend.imag.tolist()]}),
    }


def impedance_from(section: Section, parameters: set[str]) -> ImpedanceChange:
    """The change of :func:`impedance_to`."""
    section.refuse_others(("parameter", "share", *COORDINATE_KEYS, *_AXES, "real_H", "imaginary_H", "bend_H"))
    axes = [section.section(name) for name in _AXES]
    found = [knots_from(one, "knots", one.integer("degree", 0, 9)) for one in axes]
    shape = tuple(len(knots) - degree - 1 for knots, degree in found)
    parts = [section.array(key, *_OF_CIRCUITS) for key in ("real_H", "imaginary_H")]
    for key, part in zip(("real_H", "imaginary_H"), parts, strict=True):
        if part.shape[:3] != shape or part.shape != parts[0].shape or len(set(part.shape[3:])) > 1:
            raise section.refusal(key, f"nested lists of {shape} numbers, as the knots ask for")
    bend = None
    if "bend_H" in section.data:
        bend = section.array("bend_H", *(1 + dimensions for dimensions in _OF_CIRCUITS))
        if bend.shape != (2, *parts[0].shape):
            raise section.refusal("bend_H", "two nested lists, its real and its imaginary part, as those of real_H")
    (u, m), (i, n), (f, k) = found
    return ImpedanceChange(
        parameter=_parameter_of(section, parameters),
        coordinate=coordinate_from(section),
        knots=(u, i, f),
        degrees=(m, n, k),
        coefficients=parts[0] + 1j * parts[1],
        share=section.truth("share"),
        bend=None if bend is None else bend[0] + 1j * bend[1],
    )


def _curves_from(section: Section | None, parameters: set[str]) -> dict[str, Curve]:
    keys = section.data if section is not None else ()
    return {key: _curve_from(section.section(key), parameters) for key in keys if section is not None}


def _curve_from(section: Section, parameters: set[str]) -> Curve:
    section.refuse_others(("parameter", "knots", "degree", "coefficients"))
    knots, degree = knots_from(section, "knots", section.integer("degree", 1, 9))
    coefficients = section.shaped("coefficients", (len(knots) - degree - 1,))
    return Curve(_parameter_of(section, parameters), knots, degree, coefficients)


def _brake_from(section: Section, parameters: set[str]) -> Brake:
    section.refuse_others(("against", "rounded_m_s"))
    return Brake(_curve_from(section.section("against"), parameters), section.number("rounded_m_s", positive=True))


def _parameter_of(section: Section, known: set[str]) -> str:
    name = section.text("parameter")
    if name not in known:
        raise section.refusal("parameter", f"one of the effect's ({', '.join(sorted(known))})")
    return name


_JSON_DRAWN_TEXTS = ("key", "subject", "unit")
_TRUTHS = ("conducts", "at_rest")


def drawn_to(drawn: DrawnEffect) -> dict[str, Any]:
    """A number as JSON-ready data."""
    return {
        **{key: getattr(drawn, key) for key in _JSON_DRAWN_TEXTS},
        "also": list(drawn.also),
        "value": drawn.value,
        "tolerance": drawn.tolerance,
        "magnetics": [term_to(term) for term in drawn.terms],
        **({} if drawn.impedance is None else {"impedance": impedance_to(drawn.impedance)}),
        **{key: True for key in _TRUTHS if getattr(drawn, key)},
        **({"stands_for": drawn.stands_for} if drawn.stands_for else {}),
        **({"gap_m": drawn.gap_m} if drawn.gap_m else {}),
    }


def drawn_from(section: Section) -> DrawnEffect:
    """The number of :func:`drawn_to`."""
    known, impedance = {parameter_name(section.text("unit"))}, section.optional_section("impedance")
    beside = (impedance or section.data.get("conducts")) and section.data.get("magnetics") == []
    terms = () if beside else section.sections("magnetics")
    return section.record(
        DrawnEffect,
        others=("magnetics",),
        also=section.names("also") if "also" in section.data else (),
        tolerance=section.number("tolerance", positive=True),
        terms=tuple(term_from(one, known) for one in terms),
        impedance=impedance_from(impedance, known) if impedance else None,
        gap_m=section.number("gap_m", absent=0.0) if terms else 0.0,
    )
