"""A pair of magnets without a coil is compared and diagnosed by its force over distance."""

import numpy as np
import pytest

from femfit.audit.audit_model import audit_model
from femfit.core.errors import MissingPartError, TableError
from femfit.effects.catalogue import all_effects
from femfit.effects.conditions import Conditions
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.experiments.plan import possible_experiments
from femfit.identify.experiments.suggest import suggest
from femfit.identify.readings.bench import placed
from femfit.identify.signatures import why_untestable
from femfit.model.readings import predict_readings
from femfit.tables.measurement import CHANNELS
from support.magnet_pair import bench_csv, force, magnet_pair


@pytest.fixture(scope="module")
def model():
    return magnet_pair()


@pytest.fixture(scope="module")
def shifted(tmp_path_factory):
    return bench_csv(tmp_path_factory.mktemp("bench") / "shifted.csv", shift_m=0.1e-3)


def test_a_table_without_currents_is_compared(model, tmp_path):
    found = diagnose(model, bench_csv(tmp_path / "clean.csv"), bootstrap=0)
    assert found.verdict == "nothing_missing"


def test_a_gap_that_is_larger_is_named(model, shifted):
    found = diagnose(model, shifted, bootstrap=0)
    assert found.missing[0].name == "distance_offset"
    assert found.missing[0].parameters["offset_m"] == pytest.approx(0.1e-3, rel=0.2)


def test_a_body_that_passes_the_face_is_diagnosed_like_one_that_does_not(model, shifted, tmp_path):
    table = bench_csv(tmp_path / "passing.csv", shift_m=0.1e-3, passed_m=6e-3)
    found, before = diagnose(magnet_pair(6e-3), table, bootstrap=0), diagnose(model, shifted, bootstrap=0)
    assert len(found.observations.residual) == len(before.observations.residual)
    assert found.missing[0].name == "distance_offset"


def test_only_effects_that_it_can_have_are_considered(model, shifted):
    observations = placed(model, shifted)
    reasons = {name: why_untestable(effect, observations) for name, effect in all_effects().items()}
    considered = {name for name, why in reasons.items() if not why}
    assert {"remanence", "distance_offset", "force_gain", "magnet_temperature"} <= considered
    without_coil = {name for name, why in reasons.items() if "no coil" in why}
    assert {"turns", "resistance", "current_gain", "hysteresis", "driver_gain", "motional_emf"} <= without_coil
    assert "Hall element" in reasons["hall_offset"]


def test_no_flux_linkage_is_suggested_where_there_is_no_winding(model, tmp_path):
    little = bench_csv(tmp_path / "little.csv", shift_m=0.02e-3)
    assert len(suggest(model, little).explanations) > 1
    observations = placed(model, little)
    read = predict_readings(
        model, np.array([5e-3]), np.array([0.0]), Conditions(observations.nominal), channels=CHANNELS
    )
    measurements = possible_experiments(observations, tuple(read), list(all_effects().values()))
    assert any("once more, on a new mount" in one.text for one in measurements)
    assert not any("flux linkage" in one.text for one in measurements)


def test_a_table_without_currents_is_refused_beside_a_model_with_a_circuit(levitation_model, shifted):
    with pytest.raises(TableError, match="current_A"):
        placed(levitation_model, shifted)


def test_the_audit_asks_for_no_inductance(model):
    findings = audit_model(model).findings
    assert not [one for one in findings if one.severity == "wrong"]
    assert "inductance" not in {one.code for one in findings}


def test_what_needs_a_circuit_is_refused_because_there_is_no_coil(model):
    with pytest.raises(MissingPartError, match="no coil"):
        model.require_circuit()


def test_a_body_that_is_let_go_shows_its_mass_over_its_force(model, tmp_path):
    """Motion under the magnets' force and its weight, by another method, with a body that is 20 % heavier."""
    mass, step, lines = 1.2 * model.motion.mass_kg, 1e-5, ["run,time_s,distance_m"]
    noise = np.random.default_rng(3)
    for run, start in enumerate((15e-3, 12e-3, 9e-3), 1):
        d, v, k = start, 0.0, 0
        while d > 1e-3:
            v += step * (model.motion.gravity_m_s2 - float(force(d)) / mass)
            d += step * v
            if k % 10 == 0:
                lines.append(f"{run},{k * step:.6f},{d + noise.normal(0.0, 2e-6):.9f}")
            k += 1
    path = tmp_path / "falls.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = diagnose(model, path, bootstrap=0)
    assert {"mass_error", "remanence"} <= set(found.missing[0].members)  # a motion alone shows their ratio
