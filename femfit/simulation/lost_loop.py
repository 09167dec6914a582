"""A loop of which runs were lost, to be run again on the same noise with one thing or another improved."""

from copy import deepcopy
from dataclasses import dataclass, field, replace

import numpy as np

from femfit.core.arrays import BoolArray
from femfit.core.errors import DomainError, FilterError
from femfit.device.circuit import Circuit
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.design import ControllerName, LoopDesign, ObserverName, design_loop
from femfit.simulation.experiment import Experiment, run_experiments
from femfit.simulation.loop import LoopResult
from femfit.simulation.loop_progress import LoopProgress, stage

START_ERROR = 5e-3
"""Conventional: how far the body starts off where hardly any noise disturbs it, over the reference distance."""

HARDLY = 0.02
"""Conventional: part of the noise that stands for none; a filter needs to know some."""

CERTAIN = 30.0
"""Derived: growth times duration from which a deviation of one rounding, 1e-13 of the range, has grown to the range."""

AMPLE = 10.0
"""Conventional: factor on a driver's limits that stands for a driver that is never short."""


@dataclass(frozen=True)
class Improved:
    """What is better than it was: factors on noise, delays and limits, and what is taken away."""

    noise: float = 1.0
    delay: float = 1.0
    authority: float = 1.0
    unlimited_range: bool = False
    no_faults: bool = False
    true_plant: bool = False
    designed: bool = False  # Gains as designed in place of given ones
    controller: ControllerName | None = None
    observer: ObserverName | None = None


@dataclass(frozen=True, eq=False)
class LostLoop:
    """Everything that is needed to run a loop again."""

    design: LoopDesign
    experiment: Experiment
    random: np.random.Generator  # As it was before the first run; it is copied
    runs: int
    steps: int  # Of each run, as far as it is to be followed
    path_steps: int  # That the reference is laid out for
    supported_steps: int
    plant: ActuatorModel | None  # What truly moves, where that is another model than the design's
    progress: LoopProgress | None = None
    known: dict[Improved, BoolArray | None] = field(default_factory=dict)  # What was tried already
    designs: dict[Improved, LoopDesign] = field(default_factory=dict)

    def held(self, better: Improved) -> BoolArray | None:
        """Which runs are held with something improved; None where no such loop can be designed."""
        if better not in self.known:
            self.known[better] = self._held(better)
        return self.known[better]

    def _held(self, better: Improved) -> BoolArray | None:
        try:
            if self._grows(better):
                return np.zeros(self.runs, dtype=np.bool_)
            return self.again(better).held
        except (DomainError, FilterError):
            return None

    def _grows(self, better: Improved) -> bool:
        """Whether the linear loop tells already that this is no loop to advise, so that it need not be run."""
        if self.plant is not None and not better.true_plant:
            return False
        design, e = self.designed(better), self._experiment(better)
        growth = design.bench(e.observer).growth(design.controller(e.controller))
        return growth * self.steps * design.model.sample_time_s > CERTAIN

    def again(self, better: Improved, recorded: int = 0) -> LoopResult:
        """The runs on the same noise, with something improved."""
        (result,) = run_experiments(
            self.designed(better),
            [self._experiment(better)],
            deepcopy(self.random),
            runs=self.runs,
            steps=self.steps,
            supported_steps=self.supported_steps,
            recorded=recorded,
            plant=None if self.plant is None or better.true_plant else improved(self.plant, better),
            path_steps=self.path_steps,
            show=stage(self.progress, f"why runs are lost, trial {len(self.known) + 1}"),
        )
        return result

    def designed(self, better: Improved) -> LoopDesign:
        """The design for what is improved; the loop's own, gains included, where no hardware is."""
        own = self.design
        as_drawn = Improved(
            noise=better.noise,
            delay=better.delay,
            authority=better.authority,
            unlimited_range=better.unlimited_range,
        )
        if as_drawn == Improved() and not (better.designed or better.controller):
            return own
        if as_drawn not in self.designs:
            self.designs[as_drawn] = self._designed_for(as_drawn)
        return self.designs[as_drawn]

    def _designed_for(self, better: Improved) -> LoopDesign:
        own = self.design
        if better == Improved():
            return replace(own, given={})
        model = replace(improved(own.model, better), reference_distances_m=own.targets_m)
        noise = {name: better.noise * white for name, white in own.noise.items()}
        latency = int(better.delay * own.latency)
        design = design_loop(model, noise, sensors=own.sensors, latency=latency)
        return replace(design, reference_rate_rad_s=own.reference_rate_rad_s)

    def _experiment(self, better: Improved) -> Experiment:
        e = self.experiment
        if better.no_faults:
            e = Experiment(
                e.controller, e.observer, e.targets_m, noise_scale=e.noise_scale, start_error_m=e.start_error_m
            )
        if better.noise <= HARDLY:  # without a first error an unstable loop would stay at rest
            e = replace(e, start_error_m=START_ERROR * e.targets_m[0])
        return replace(e, controller=better.controller or e.controller, observer=better.observer or e.observer)


def improved(model: ActuatorModel, better: Improved) -> ActuatorModel:
    """A model whose sensors and drivers are better."""
    sensors = tuple(replace(one, delay_s=better.delay * one.delay_s) for one in model.other_sensors)
    if better.unlimited_range:
        sensors = tuple(replace(one, minimum=None, maximum=None) for one in sensors)
    hall = model.sensor and replace(model.sensor, delay_s=better.delay * model.sensor.delay_s)
    model = replace(model, other_sensors=sensors, sensor=hall)
    if better.unlimited_range and model.sensor is not None:
        wide = 1e3 * (model.sensor.output_max_V - model.sensor.output_min_V)
        model = replace(model, sensor=replace(model.sensor, output_min_V=-wide, output_max_V=wide, adc_bits=0))
    if better.authority == 1.0:
        return model
    circuits = tuple(stronger(circuit, better.authority) for circuit in model.circuits)
    box, more = model.validity, better.authority
    wider = replace(
        box,
        current_min_A=more * box.current_min_A if box.current_min_A < 0.0 else box.current_min_A,
        current_max_A=more * box.current_max_A if box.current_max_A > 0.0 else box.current_max_A,
        further_A=tuple((more * low if low < 0.0 else low, more * high) for low, high in box.further_A),
    )
    return replace(model, circuits=circuits, validity=wider)


def stronger(circuit: Circuit, factor: float) -> Circuit:
    """A driver whose limits are so many times wider."""
    drive = circuit.drive
    wide = replace(
        drive,
        current_min_A=None if drive.current_min_A is None else factor * drive.current_min_A,
        current_max_A=None if drive.current_max_A is None else factor * drive.current_max_A,
    )
    low, high = circuit.voltage_min_V, circuit.voltage_max_V
    return replace(
        circuit,
        drive=wide,
        voltage_min_V=factor * low if low < 0.0 else low,
        voltage_max_V=factor * high if high > 0.0 else high,
    )
