"""Hidden effects in iron and magnets: their fields are solutions of changed drawings."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.constants import MU_0
from femfit.device.parts import Region
from femfit.trial.field_table import Fields
from femfit.trial.off_axis import displaced
from femfit.trial.truths.preisach import relay_ensemble
from support.trial_study.truth.bench import Hidden, Points
from support.trial_study.truth.families import Truth
from support.trial_study.truth.thermal import REFERENCE_C

_REMANENCE_PER_K, _REMANENCE_PER_K2 = -1.15e-3, -1.0e-6
"""Sintered NdFeB between 20 and 100 degC, of the order of data sheets: its curve bends downwards."""


def core_saturation(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A core that saturates: the nonlinear solution, blended with the linear one."""
    sharpness = float(
        generator.choice([name.split("-")[1] for name in truth.families if name.startswith("saturation")])
    )
    family = truth.families[f"saturation-{sharpness:g}"]
    return Hidden(
        "core_saturation",
        typical=0.3,
        limit=2.0,
        unit="",
        fields=lambda size, at: family.change(1.0, at.distance, at.current).times(size),
        constants={"sharpness": sharpness},
    )


def hysteresis(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A core that remembers its currents: Preisach relays along the actual history set its remanence.

    In half of the campaigns the current is cycled before each run, in the others a run starts demagnetised.
    """
    family = truth.families["memory"]
    scale = max(map(abs, truth.actuator.sweep.currents_A))
    coercive, interaction, spread = generator.uniform([0.1, 0.25, 0.3], [0.25, 0.5, 0.6])
    cycles = int(generator.choice([0, 3]))

    def field(size: float, at: Points) -> Fields:
        relays = relay_ensemble(coercive * scale, interaction * scale, spread)
        memory = np.empty(len(at.current))
        for run in np.unique(at.run):
            during = at.current[at.run == run]
            before = np.tile([during.max(), during.min()], cycles)
            memory[at.run == run] = relays.irreversible(np.concatenate([before, during]))[len(before) :]
        return family.change(size * memory, at.distance, at.current)

    constants = {
        "coercive": float(coercive),
        "interaction": float(interaction),
        "spread": float(spread),
        "cycles_before": float(cycles),
    }
    return Hidden("hysteresis", typical=0.02, limit=1.0, unit="T", fields=field, constants=constants)


def magnet_temperature(truth: Truth, generator: np.random.Generator) -> Hidden:
    """Magnets that weaken as they warm, with a curved characteristic; size 1 is usual NdFeB."""
    family = truth.families["magnets"]
    bend = float(generator.uniform(0.0, 3.0))

    def field(size: float, at: Points) -> Fields:
        warmer = at.magnet_C - REFERENCE_C
        change = size * (_REMANENCE_PER_K * warmer + bend * _REMANENCE_PER_K2 * warmer**2)
        return family.change(change, at.distance, at.current)

    return Hidden("magnet_temperature", typical=1.0, limit=2.5, unit="", fields=field, constants={"bend": bend})


def magnet_demagnetisation(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A magnet whose layer next to the gap has lost part of its remanence."""
    family = truth.families["layer"]
    return Hidden(
        "magnet_demagnetisation",
        typical=0.2,
        limit=1.0,
        unit="",
        fields=lambda size, at: family.change(-size, at.distance, at.current),
    )


def position_dependent_inductance(truth: Truth, generator: np.random.Generator) -> Hidden:
    """Iron of the body's holder, or another clearance, which makes the winding's inductance follow the body otherwise.

    Only the part quadratic in the current is taken: the iron sits where the magnets do not reach it.
    """
    family = truth.families["ring"]
    sign = float(generator.choice([-1.0, 1.0])) if "bore" in truth.families else 1.0

    def field(size: float, at: Points) -> Fields:
        change = family.change(1.0, at.distance, at.current)
        return Fields(change.force, change.flux_linkage, np.zeros_like(change.hall)).times(sign * size)

    return Hidden(
        "position_dependent_inductance", typical=1.0, limit=5.0, unit="", fields=field, constants={"sign": sign}
    )


def lateral_misalignment(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A body beside the axis: the three-dimensional solution of a magnet, or a plunger's eccentric gap."""
    if "bore" in truth.families:
        family = truth.families["bore"]
        return Hidden(
            "lateral_misalignment",
            typical=0.2e-3,
            limit=0.42e-3,
            unit="m",
            fields=lambda size, at: family.change(size**2, at.distance, at.current),
        )
    distances = truth.base.distances
    # Displaced by a tenth of the nearest distance: the next order is below 1 % of the first there
    off = displaced(truth.actuator, 0.1 * distances[0], distances)

    def ratio(values: FloatArray, at: Points) -> FloatArray:
        return np.interp(np.log(at.distance), off.log_distance, values)

    def field(size: float, at: Points) -> Fields:
        zero = np.zeros_like(at.current)
        passive = truth.base.at(at.distance, zero)
        both = truth.base.at(at.distance, at.current)
        opposite = truth.base.at(at.distance, -at.current)
        per_ampere = 0.5 * (both.force - opposite.force)
        return Fields(
            size**2 * (ratio(off.passive, at) * passive.force + ratio(off.coil, at) * per_ampere),
            size**2 * ratio(off.flux, at) * passive.flux_linkage,
            size**2 * ratio(off.hall, at) * passive.hall,
        )

    return Hidden("lateral_misalignment", typical=1e-3, limit=3e-3, unit="m", fields=field)


def external_field(truth: Truth, generator: np.random.Generator) -> Hidden:
    """A uniform field along the axis: on the Hall element, in the core, through the winding; its gradient on the body.

    Soft iron in an outer field B_0 is magnetised as if it had the remanence (mu_r - 1) B_0.
    """
    family = truth.families["core"]
    gradient = float(generator.uniform(-2.0, 2.0))
    r, _ = np.array(truth.actuator.coil.vertices_m).T
    area = truth.actuator.coil.turns * np.pi * (r.max() ** 2 + r.max() * r.min() + r.min() ** 2) / 3.0
    susceptibility = max(region.material.relative_permeability for region in truth.actuator.fixed) - 1.0
    moment = sum(_moment(region) for region in truth.actuator.moving.regions)

    def field(size: float, at: Points) -> Fields:
        change = family.change(susceptibility * size, at.distance, at.current)
        return Fields(change.force + size * gradient * moment, change.flux_linkage + size * area, change.hall + size)

    return Hidden(
        "external_field", typical=1e-3, limit=2e-2, unit="T", fields=field, constants={"gradient_1_per_m": gradient}
    )


def _moment(region: Region) -> float:
    """Magnetic moment of a magnet drawn as a rectangle, in A m^2."""
    r, z = np.array(region.vertices_m).T
    volume = np.pi * (r.max() ** 2 - r.min() ** 2) * np.ptp(z)
    return float(region.material.remanence_T / MU_0 * volume)
