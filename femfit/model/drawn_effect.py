"""A number of the drawing as an effect: what it changes of W'(d, i) and of the Hall field, to first order in it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import field as limited
from functools import cached_property

from femfit.effects.effect import Calibration, Effect, EffectParameter
from femfit.model.carried import Carried, Conductivity, FieldTerm
from femfit.model.impedance import ImpedanceChange

PLAUSIBLE, POSSIBLE = 3.0, 10.0
"""Conventional: standard deviations within which a number is expected, and beyond which a slope says nothing of it."""

LEAST = -0.9
"""Of a share: a tenth of the drawn number is left, whatever a fit tries."""

NEAREST = 0.5
"""Numerical: part of the smallest swept distance, with what adds to it as the flux's path, that a face may close."""

NEEDS: tuple[str, ...] = ("force_N|flux_linkage_Wb|inductance_H|hall_V",)

HARMONIC_NEEDS = "frequency_Hz", "inductance_H|resistance_ohm"
"""Of a number without a part in the static field, as a conductivity."""

EDDY_NEEDS = "frequency_Hz|time_s", "inductance_H|resistance_ohm|voltage_V|force_N|hall_V|distance_m"
"""Of the conductivity of all that conducts."""

CHANGE = "change"

OMIT = {"omit": True}

MICROMETER_MM, MICROMETER_COST = 0.01, 40.0
"""Assumed: standard uncertainty of a dimension that a micrometer reads on the part, and what getting at the part costs,
in readings of a usual sweep."""

SENSORS = "hall.", "sensors."
"""Beginnings of the key paths of what stands inside of a package, where no micrometer reaches."""


@dataclass(frozen=True, eq=False)
class DrawnEffect:
    """A number of the drawing, with the splines of what it changes per unit."""

    key: str  # Key path in the drawing, and the effect's name
    subject: str  # The number as the subject of a sentence
    unit: str  # As the drawing has it; empty where changes are shares of the number
    also: tuple[str, ...] = limited(default=(), kw_only=True)  # Key paths of what moves with it
    value: float  # As drawn, in the drawing's unit
    tolerance: float = limited(metadata={"positive": True})  # Standard deviation, in the unit or as a share
    # In proportion to :attr:`parameter`
    terms: tuple[FieldTerm, ...] = limited(default=(), metadata={"key": "magnetics", "required": True, "least": 0})
    impedance: ImpedanceChange | None = limited(default=None, metadata=OMIT)  # Beside what the terms make of it
    conducts: bool = limited(default=False, metadata=OMIT)  # Whether it is the conductivity of all that conducts
    # Whether fields at rest depend on it though the model has no terms for that: impedances tell it, nothing carries it
    at_rest: bool = limited(default=False, metadata=OMIT)
    stands_for: str = limited(default="", metadata=OMIT)  # Key of the number that is no suspect beside this one
    # Of a face at the gap: by how much a unit of the parameter shortens the distance
    gap_m: float = limited(default=0.0, metadata=OMIT)

    def faults(self) -> Iterator[tuple[str, str]]:
        """Nothing that it changes, or what another parameter changes."""
        if not (self.terms or self.impedance or self.conducts):
            yield "magnetics", "a list of objects, at least one"
        yield from self._carried().unknown([self.parameter])

    @property
    def parameter(self) -> str:
        """Name of the amplitude: true less drawn value in the drawing's unit, or as a share of it."""
        return parameter_name(self.unit)

    def _carried(self) -> Carried:
        terms = self.terms if self.terms or self.at_rest else None
        conductivity = Conductivity(self.parameter) if self.conducts else None
        return Carried(terms, impedance=self.impedance, conductivity=conductivity, gap_m=self.gap_m)

    @cached_property
    def effect(self) -> Effect:
        """The effect, named by the key path."""
        drawn = f"{self.value:g} {self.unit}".rstrip()
        also = f" With it moves what touches it: {', '.join(self.also)}." if self.also else ""
        words = f"it is {{size}} {{more|less}} than the drawn {drawn}"
        if not self.unit:
            words = f"{self.subject} is {{size}} {{larger|smaller}} than drawn"
        change = EffectParameter(
            self.parameter,
            unit=self.unit,
            bounds=self._within(POSSIBLE),
            plausible=self._within(PLAUSIBLE),
            description=f"True less drawn value of {self.key}{'' if self.unit else ', over the drawn one'}.{also}",
            words=words,
        )
        shown, needs = "Force, flux linkage and Hall voltage", NEEDS
        if self.conducts:
            shown, needs = "Impedances and the lag of the field", EDDY_NEEDS
        elif not self.terms:  # impedances alone show it
            shown, needs = "Impedances", HARMONIC_NEEDS
        calibrations: tuple[Calibration, ...] = ()
        if self.unit == "mm" and not self.key.startswith(SENSORS):  # a dimension can be read on the part itself
            text = f"Measure {self.subject} on the device itself, to {MICROMETER_MM:g} mm."
            calibrations = (Calibration({self.parameter: MICROMETER_MM}, MICROMETER_COST, text),)
        return self._carried().effect(
            self.key,
            f"{shown} are those of a device in which {self.key} is another number.",
            (change,),
            needs=needs,
            experiment=f"Measure {self.subject} on the device itself.",
            calibrations=calibrations,
            reference="Signature computed from the drawing's own field",
            title="" if self.subject == self.key else self.subject,
            stands_for=self.stands_for,
        )

    def _within(self, tolerances: float) -> tuple[float, float]:
        """So many tolerances either way, and of a face at the gap at most half of the smallest path of the flux."""
        size = tolerances * self.tolerance
        low, high = max(-size, -math.inf if self.unit else LEAST), size
        for term in self.terms if self.gap_m else ():
            if term.coenergy is not None and (u := term.coenergy.coordinate).inverse:
                room = NEAREST * u.reference_distance_m / (term.coenergy.spline.x_knots[-1] * abs(self.gap_m))
                low, high = (low, min(high, room)) if self.gap_m > 0.0 else (max(low, -room), high)
        return low, high


def parameter_name(unit: str) -> str:
    """Name of the amplitude of a number with a unit, or of one without."""
    return f"{CHANGE}_{unit}" if unit else CHANGE
