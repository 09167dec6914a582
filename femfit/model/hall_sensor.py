"""The Hall element of a model: its field, its output and its converter."""

from dataclasses import dataclass
from dataclasses import field as limited

from femfit.core.arrays import FloatArray
from femfit.model.hall import HallField

# Limits in a field's metadata are what a model file is held to: see femfit.model.json_section.


@dataclass(frozen=True)
class HallSensor:
    """The Hall element: field, linear output, converter."""

    field: HallField
    sensitivity_V_per_T: float
    quiescent_V: float
    output_min_V: float
    output_max_V: float = limited(metadata={"not_below": "output_min_V"})
    adc_bits: int = limited(metadata={"within": (0, 64)})
    noise_V: float = limited(default=0.0, metadata={"lower": 0.0})
    delay_s: float = limited(default=0.0, metadata={"lower": 0.0, "absent": 0.0})
    sample_time_s: float | None = None  # None: the controller's

    @property
    def quantisation_step(self) -> float:
        """One step of the converter in V; 0 where there is none."""
        return (self.output_max_V - self.output_min_V) / 2.0**self.adc_bits if self.adc_bits else 0.0

    def voltage(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """Output in V without noise, clipping or quantisation."""
        return self.quiescent_V + self.sensitivity_V_per_T * self.field.field(distance, current)
