"""Numbers of the drawing, with what they change, in a model file."""

from typing import Any

from femfit.model.drawn_effect import DrawnEffect, parameter_name
from femfit.model.json_carried import impedance_from, impedance_to, term_from, term_to
from femfit.model.json_section import Section

_TEXTS = ("key", "subject", "unit")
_TRUTHS = ("conducts", "at_rest")


def drawn_to(drawn: DrawnEffect) -> dict[str, Any]:
    """A number as JSON-ready data."""
    return {
        **{key: getattr(drawn, key) for key in _TEXTS},
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
    section.refuse_others(
        (*_TEXTS, *_TRUTHS, "also", "value", "tolerance", "magnetics", "impedance", "stands_for", "gap_m")
    )
    also = section.data.get("also", [])
    if not isinstance(also, list) or not all(isinstance(one, str) for one in also):
        raise section.refusal("also", "a list of key paths")
    texts = {key: section.text(key) for key in _TEXTS}
    known, impedance = {parameter_name(texts["unit"])}, section.optional_section("impedance")
    truths = {key: key in section.data and section.truth(key) for key in _TRUTHS}
    beside = (impedance or truths["conducts"]) and section.data.get("magnetics") == []
    terms = () if beside else section.sections("magnetics")
    return DrawnEffect(
        **texts,
        also=tuple(also),
        value=section.number("value"),
        tolerance=section.number("tolerance", positive=True),
        terms=tuple(term_from(one, known) for one in terms),
        impedance=impedance_from(impedance, known) if impedance else None,
        conducts=truths["conducts"],
        at_rest=truths["at_rest"],
        stands_for=section.text("stands_for") if "stands_for" in section.data else "",
        gap_m=section.number("gap_m", absent=0.0) if terms else 0.0,
    )
