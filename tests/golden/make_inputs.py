"""How some of the stored inputs came about; the stored files are the truth, and nothing here runs in a test."""

import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))


import femfit as ff
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.with_effects import with_effects
from golden.door import INPUTS, model

EFFECTS = {
    "rig": {
        "hysteresis": {"width_small": 0.005, "width_medium": 0.01},
        "core_saturation": {"mmf_loss_3": 0.03},
        "lateral_misalignment": {"offset_squared_m2": 2e-6},
        "hall_offset": {"offset_V": 0.05},
        "coulomb_friction": {},
        "viscous_friction": {},
        "distance_offset": {},
    },
    "plunger": {
        "eddy_current_lag": {"ring_share": 0.1, "diffusion_share": 0.1, "time_s": 2e-3},
        "remanence": {},
        "turns": {},
        "resistance": {},
    },
    "bearing": {"turns:upper": {}, "resistance:lower": {}, "distance_offset": {}, "force_gain": {}},
}


def added(name, given):
    """An effect with parameters; a tenth of the plausible range for what is not given."""
    effect = effect_by_name(name)
    values = {one.name: one.null for one in effect.parameters}
    if not given:
        first = next(one for one in effect.parameters if not one.nonlinear)
        given = {first.name: first.null + 0.1 * first.width}
    return AddedEffect(effect, values | given)


def models():
    """Models with effects from those without."""
    for name, effects in EFFECTS.items():
        one = replace(model(name), drawn=())
        one = with_effects(one, [added(effect, given) for effect, given in effects.items()])
        ff.write_model(one, INPUTS / "models" / f"{name}-effects.json")


if __name__ == "__main__":
    models()
