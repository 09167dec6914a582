"""Self-force noise: its size, its alarm, and the false and missed alarms of that."""

import numpy as np
import pytest

from femfit.tables.foreign.noise import MIN_DISTANCES, NOISY, check_noise, compare_forces, measure_roughness

LAWS = {
    "F1e": lambda d: 6e-9 * d**-4.0,
    "exponential": lambda d: np.exp(-d / 5e-3),
    "shifted dipole": lambda d: 1e-9 / (d + 8e-3) ** 4,
    "dipole and exponential": lambda d: 4e-9 * d**-4.0 + 0.3 * np.exp(-d / 4e-3),
    "reluctance": lambda d: 1e-6 / (d + 2e-3) ** 2,
    "cylinder magnets": lambda d: 1e-6 * (d**-2.0 + (d + 1e-2) ** -2.0 - 2 * (d + 5e-3) ** -2.0),
    "plunger with a maximum": lambda d: np.exp(-(((d - 12e-3) / 9e-3) ** 2)),
    "plunger that turns": lambda d: np.cos(d / 8e-3) * np.exp(-d / 2e-2),
}
GRIDS = {
    "61 even": np.linspace(15e-3, 45e-3, 61),
    "20 even": np.linspace(0.5e-3, 20e-3, 20),
    "9 even": np.linspace(3e-3, 15e-3, 9),
    "9 wide": np.linspace(1e-3, 30e-3, 9),
    "9 logarithmic over two decades": np.geomspace(0.3e-3, 30e-3, 9),
    "25 uneven": np.sort(np.random.default_rng(5).uniform(2e-3, 30e-3, 25)),
}


def alarm(distances, force):
    curve = measure_roughness(distances, force)
    return curve.resolved and curve.relative > NOISY


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("name", LAWS)
def test_a_smooth_law_raises_no_alarm(name, grid):
    assert not alarm(GRIDS[grid], LAWS[name](GRIDS[grid]))


@pytest.mark.parametrize("name", [name for name in LAWS if "plunger" not in name])
def test_noise_of_a_fine_sweep_is_measured_in_size(name):
    distances, rng = GRIDS["61 even"], np.random.default_rng(3)
    for noise in (0.002, 0.01, 0.1):
        force = LAWS[name](distances)
        sizes = [
            measure_roughness(distances, force * (1 + noise * rng.standard_normal(61))).relative for _ in range(20)
        ]
        # 56 overlapping contrasts scatter by 16 %, the mean of 20 by 4 %; cutting at three deviations takes 3 %.
        assert np.mean(sizes) == pytest.approx(noise, rel=0.12)


@pytest.mark.parametrize(
    ("grid", "noise", "least", "most"),
    [
        # Rates of 200 tables; from the median's scatter at threshold 0.5 %: 1 % on 61 points is always seen.
        ("61 even", 0.01, 0.98, 1.0),
        ("61 even", 0.002, 0.0, 0.0),
        ("20 even", 0.01, 0.85, 1.0),
        ("20 even", 0.002, 0.0, 0.03),
        ("25 uneven", 0.01, 0.85, 1.0),
        ("9 even", 0.02, 0.75, 1.0),
        ("9 even", 0.002, 0.0, 0.1),
    ],
)
def test_rates_of_alarms_on_noisy_tables(grid, noise, least, most):
    distances, rng = GRIDS[grid], np.random.default_rng(11)
    force = LAWS["F1e"](distances)
    alarms = [alarm(distances, force * (1 + noise * rng.standard_normal(len(distances)))) for _ in range(200)]
    assert least <= np.mean(alarms) <= most


def test_one_per_cent_common_to_all_currents_is_a_self_force(law):
    table = law.table(distances=GRIDS["61 even"])
    passive = law.force(GRIDS["61 even"], 0.0)
    table["force"] += np.tile(0.01 * passive * np.random.default_rng(4).standard_normal(61), 4)
    points, (finding,) = check_noise(table)
    assert (finding.code, finding.severity) == ("self-force", "warning")
    assert finding.size == pytest.approx(0.01, rel=0.4)
    assert "at 0 A" in finding.text
    # The error of a row is the size of noise that was put in: its level within the scatter of 16 %, its slope over the
    # distances within a factor of three at the ends (log of 56 contrasts against log d).
    ratio = points["force_error"] / np.tile(0.01 * passive, 4)
    assert 0.6 < ratio.median() < 1.6
    assert ratio.between(1 / 3, 3).all()


def test_one_per_cent_of_the_whole_force_is_seen_too(law):
    table = law.table(distances=GRIDS["61 even"])
    table["force"] *= np.tile(1 + 0.01 * np.random.default_rng(4).standard_normal(61), 4)
    _, (finding,) = check_noise(table)
    assert finding.severity == "warning"


def test_noise_of_its_own_at_each_point_is_told_from_a_self_force(law):
    table = law.table(distances=GRIDS["61 even"])
    table["force"] *= 1 + 0.02 * np.random.default_rng(7).standard_normal(len(table))
    _, (finding,) = check_noise(table)
    assert (finding.code, finding.severity) == ("noise", "warning")
    assert "differs from current to current" in finding.text


@pytest.mark.parametrize("magnet", [True, False])
def test_an_analytic_table_is_called_smooth(make_law, magnet):
    points, (finding,) = check_noise(make_law(magnet, saturating=True).table())
    assert finding.severity == "info"
    assert "smooth" in finding.text
    assert (points["force_error"] > 0).all()
    assert (points["force_error"] < 1e-4 * points["force"].max()).all()


def test_few_distances_are_not_judged(law):
    points, (finding,) = check_noise(law.table(distances=np.linspace(5e-3, 25e-3, MIN_DISTANCES - 1)))
    assert "not judged" in finding.text
    assert "force_error" not in points


def test_a_smoother_column_that_differs_is_named(law):
    distances = GRIDS["61 even"]
    table = law.table(distances=distances)
    rng = np.random.default_rng(8)
    rough = 1.02 + 0.004 * rng.standard_normal(61)  # 2 % off throughout, 0.4 % rough
    table = table.rename(columns={"force": "other:reaction"}).assign(
        force=lambda t: t["other:reaction"] * np.tile(rough, 4)
    )
    points, (finding,) = compare_forces(check_noise(table)[0])
    assert finding.size == pytest.approx(0.02, rel=0.2)
    swapped = table.rename(columns={"force": "other:reaction", "other:reaction": "force"})
    assert compare_forces(swapped)[1] == []
    error = (points["force"] - points["other:reaction"]).abs()
    assert (points["force_error"] >= error).all()


def test_a_reaction_of_opposite_sign_is_the_same_force(law):
    table = law.table(distances=GRIDS["61 even"])
    assert compare_forces(table.assign(**{"other:reaction": -table["force"]}))[1] == []


def test_a_force_on_another_body_is_no_rival(law):
    table = law.table(distances=GRIDS["61 even"])
    rough = np.tile(1 + 0.01 * np.random.default_rng(9).standard_normal(61), 4)
    table = table.assign(**{"force": table["force"] * rough, "other:lateral": 1e-3 * table["force"], "other:none": 0.0})
    points, findings = compare_forces(table)
    assert findings == []
    assert points is table
