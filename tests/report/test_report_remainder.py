"""The page on a remainder shows it as unexplained, with its picture and what would refute it."""

import numpy as np
import pytest

from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.identify.readings.bench import placed
from femfit.model.bspline import TensorSpline
from femfit.model.carried import (
    Brake,
    Carried,
    Curve,
    FieldChange,
    FieldTerm,
    FurtherResistance,
    ReadingChange,
    SettingChange,
    bounded_basis,
    carried_effect,
)
from femfit.model.coordinate import DistanceCoordinate
from femfit.report.explained_figures import remainder_figure
from support.campaign import campaign


def test_every_part_has_its_panel(levitation_model):
    share = EffectParameter("share", bounds=(0.0, 1.0), plausible=(0.0, 1.0), description="How much of it.")
    knots, expand = bounded_basis(0.02, 0.04, cells=3, degree=3)
    every = expand @ np.linspace(0.0, 1e-3, expand.shape[1])
    curve = Curve("share", knots, 3, every)
    spline = TensorSpline(knots, np.array([-9.0, 9.0]), 3, 0, every[:, None])
    term = FieldTerm("share", DistanceCoordinate(1.0, inverse=False), spline, spline)
    carried = Carried(
        FieldChange((term,)),
        SettingChange(curve, curve),
        ReadingChange({"force_N": curve, "flux_linkage_Wb": curve, "hall_V": curve}, {"force_N": curve}),
        Brake(curve, 1e-3),
        FurtherResistance(curve),
    )
    added = AddedEffect(carried_effect("unexplained", "It is not known.", [share], carried), {"share": 1.0})
    observations = placed(levitation_model, campaign(levitation_model, 3, distances=7, currents=5))
    axes = [ax for ax in remainder_figure(added, observations).axes if ax.get_xlabel()]
    said = [ax.get_title(loc="left") or ax.get_ylabel() for ax in axes]
    assert len(said) == len(set(said)) == 11
    # The force of dW' is its slope with the other sign, drawn in its own unit
    drawn = next(ax for ax in axes if ax.get_title(loc="left").startswith("force"))
    d = np.linspace(0.02, 0.04, 5)
    slope = (curve.at(d + 1e-7, {"share": 1.0}) - curve.at(d - 1e-7, {"share": 1.0})) / 2e-7
    low, high = drawn.collections[0].get_clim()
    assert high == -low
    assert high == pytest.approx(1e3 * np.abs(slope).max(), rel=0.1)
    assert "(mN)" in drawn.get_title(loc="left")
