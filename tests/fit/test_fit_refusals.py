"""Tables and options that give no model are refused with what is wrong and what to do: one row a refusal."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit import SweepTable, fit_model
from femfit.core.errors import FitError, TableError, UsageError
from femfit.fit import bounded_qp
from femfit.fit.ranking import rank_laws
from femfit.fit.rows import rows_of_table
from femfit.fit.sensed_field import fit_sensed
from femfit.laws.dipoles import F1E, F2E
from support.bearing import DISTANCES, Bearing, table_of
from support.closed_forms import POT, SIX, WIDE, Saturating, VoiceCoil, steel_sweep
from support.plungers import plunger_table
from support.sweeps import ACTUATOR, force_table, full_table


class Active(Bearing):
    """Circuits that would give energy away: the mutual inductance is larger than their own."""

    MUTUAL = (0.1, 0.0)


class Contradicting(Bearing):
    """A force that no co-energy of its flux linkages has."""

    def force(self, d, i):
        return 2.0 * super().force(d, i)


def changed(change, table=None):
    table = table or full_table()
    return replace(table, rows=change(table.rows).reset_index(drop=True))


def one_table(change):
    return lambda: changed(change)


UNUSABLE = [
    (one_table(lambda r: r.iloc[:0]), "none among its 0"),
    (one_table(lambda r: r.iloc[:9]), "at least 12 usable rows at 4 distances; instead received 9 rows at 2"),
    (one_table(lambda r: r.assign(force_N=r["force_N"].where(r.index != 7))), "force_N must hold finite.*row 8"),
    (one_table(lambda r: r.assign(force_N="1,5")), "force_N must be numeric"),
    (one_table(lambda r: r.assign(force_N=np.inf)), "finite numbers"),
    (one_table(lambda r: r.assign(flux_linkage_Wb=r["flux_linkage_Wb"].where(r.index > 3))), "flux_linkage_Wb must"),
    (one_table(lambda r: r.assign(inductance_H="2 H")), "inductance_H must be numeric"),
    (one_table(lambda r: r.drop(columns="force_N")), "force_N missing"),
    (one_table(lambda r: r[r["current_A"] == 0].assign(flux_linkage_Wb=0.0)), "flux_linkage_Wb is 0 in every row"),
    (one_table(lambda r: r.assign(distance_m=1e3 * r["distance_m"])), "distance_m seems to be in mm"),
    (one_table(lambda r: r.iloc[[*range(len(r)), 0]]), "1 repeat another, the first at 0 A and 15 mm"),
    (one_table(lambda r: r.assign(status="failed")), "none among its 488"),
    (
        one_table(lambda r: r.assign(flux_linkage_Wb=r["flux_linkage_Wb"] * np.where(r.index == 99, 1e3, 1.0))),
        "flux_linkage_Wb at .* neighbours contradict it",
    ),
    # Of several circuits: the same, and each one's flux linkage
    (lambda: changed(lambda r: r.drop(columns="flux_linkage_upper_Wb"), table_of()), "flux_linkage_upper_Wb missing"),
    (lambda: changed(lambda r: r.iloc[[*range(len(r)), 4]], table_of()), "1 repeat another, the first at 0 A, 0 A"),
    (lambda: changed(lambda r: r.assign(force_N=0.0), table_of()), "force_N is 0 in every row"),
]


def one_column(rows):
    return rows[(rows["current_A"] == 0.0) | (rows["distance_m"] > 0.0446)]


def few_turns():
    """A winding whose flux linkage contradicts the force, small as it is beside the other's."""
    table, (_, upper) = Saturating().table(), ("lower", "upper")
    columns = {f"current_{upper}_A": 50.0, f"flux_linkage_{upper}_Wb": 1.2 / 50.0}
    return changed(lambda r: r.assign(**{name: r[name] * factor for name, factor in columns.items()}), table)


def of_saturating(chosen):
    return lambda: changed(lambda r: r[chosen(r["current_lower_A"], r["current_upper_A"])], Saturating().table())


UNFIT = [
    (lambda: table_of(Contradicting()), {}, "a sign or a unit"),
    (lambda: table_of(Active()), {}, "must be positive definite"),
    (lambda: table_of(distances=DISTANCES[:4]), {}, "at least 5 distances"),
    (lambda: table_of(currents=(0.0,)), {}, "do not determine the inductances"),
    (of_saturating(lambda a, _: abs(a) == 2.0), {}, "3 currents or more"),
    (of_saturating(lambda a, b: (a == 0.0) | (b == 0.0)), {}, "every combination"),
    (lambda: Saturating().table(currents=(-40.0, -13.0, 13.0, 40.0)), {}, "Sweep more currents"),
    pytest.param(few_turns, {}, "positive definite", marks=pytest.mark.nightly),
    (lambda: steel_sweep((0.0, 10.0, 20.0), (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)), {}, "5, 15 A of bottom"),
    (lambda: steel_sweep((0.0, 3.0), (0.0, 3.0)), {}, "3 currents"),
    (lambda: steel_sweep((0.0, 20.0, 40.0), (0.0, 20.0, 40.0)), {}, "definite; .*Sweep more currents"),
    *((lambda: full_table(currents=[0.2]), {"law": law}, r"at least 3 currents.*Sweep") for law in ("F1e", None)),
    (lambda: full_table(currents=[0.0, 0.2]), {}, r"needs at least 3 currents and 5 distances.*Sweep more currents"),
    # A column without a full grid is refused before numbers are made up
    (lambda: changed(one_column, full_table(currents=[0.0, 0.7, 1.4])), {}, "do not determine"),
    # Once for all laws
    (
        lambda: full_table(currents=[0.2]),
        {"law": "all"},
        r"^No law could be fitted\. Two stages need at least 3 currents[^:]*Sweep[^:]*$",
    ),
    (lambda: VoiceCoil().table(), {"law": "F1e"}, r"F1e must have distances > 0.*moving-coil"),
    *(
        (lambda change=change: changed(change, plunger_table("push")), {"law": "reluctance-network"}, message)
        for change, message in (
            (lambda r: r.assign(flux_linkage_Wb=np.nan), "must have flux_linkage_Wb"),
            (lambda r: r[r["current_A"] > 0.5], "3 currents beside zero"),
            (lambda r: pd.concat([r, r.iloc[:8].assign(current_A=0.0)]), "plungers without a magnet"),
        )
    ),
]


@pytest.mark.parametrize(("table", "options", "message"), [*((t, None, words) for t, words in UNUSABLE), *UNFIT])
def test_a_table_that_gives_no_such_model_is_refused_with_the_reason(table, options, message):
    with pytest.raises(TableError if options is None else FitError, match=message):
        fit_model(table(), **(options or {}))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"law": "F9"}, "must be coenergy, all or a law .*F1e.*; instead received 'F9'"),
        ({"mass_kg": -1.0}, "mass_kg must be > 0"),
        ({"inductance_H": float("nan")}, "inductance_H must be > 0"),
        ({"bounds": {"d^-4": (0.0, 1.0)}}, "one law only"),
        *(({"law": "F1e", "functions": of}, "2 columns") for of in (("affine",), ("affine", "nope"), ("affine",) * 3)),
    ],
)
def test_options_that_mean_nothing_are_refused(options, message):
    with pytest.raises(UsageError, match=message):
        fit_model(full_table(), **options)


def test_several_circuits_are_fitted_by_a_coenergy_alone():
    with pytest.raises(UsageError, match="co-energy alone"):
        fit_model(table_of(), law="F1e")


@pytest.mark.parametrize("actuator", [
    {"mass_kg": "4 g"}, {"resistance_ohm": [2]}, {"sample_time_s": "soon"}, {"hall": 5}, {"kind": {"a": True}},
    {"mechanics": {"coulomb_N": "much"}},
])  # fmt: skip
def test_a_damaged_entry_of_the_actuator_is_one_clear_error(actuator):
    with pytest.raises(TableError, match="manifest"):
        fit_model(SweepTable(full_table().rows, {"actuator": {**ACTUATOR, **actuator}}), law="F2e")


def test_a_law_that_fails_leaves_the_ranking_to_the_others(monkeypatch):
    def columns(distance, _shape):
        raise ValueError("distances above 40 mm are not supported")

    def pole(distance, _shape):
        return 1.0 / (distance - distance[0]), distance

    right, rows = bounded_qp.nnls, rows_of_table(force_table(lambda d, i: 6e-9 * d**-4 + 4.5e-6 * i * d**-2))

    def only_for_f1e(matrix, values, maxiter=None):
        if matrix.shape[1] > 7:  # F2E's bounds and inequalities are eight
            raise RuntimeError("Maximum number of iterations reached.")
        return right(matrix, values, maxiter=maxiter)

    monkeypatch.setattr(bounded_qp, "nnls", only_for_f1e)
    broken = {
        "broken": (columns, "distances above 40 mm are not supported"),
        "pole": (pole, "finite"),
        "twice": (lambda d, _: (d**-3.0 / 3.0, d**-3.0 / 3.0), "do not determine d^-4"),
    }
    laws = [replace(F1E, name=name, potentials=law) for name, (law, _) in broken.items()]
    with np.errstate(divide="ignore", invalid="ignore"):
        ranking = rank_laws((*laws, F2E, F1E), rows)
    assert ranking.recommended.law is F1E
    reasons = {c.law.name: c.failure for c in ranking.candidates if c.fit is None}
    assert set(reasons) == {*broken, "F2e"}
    assert all(reason in reasons[name] for name, (_, reason) in broken.items())
    with pytest.raises(FitError, match=r"No law could be fitted\. The data do not determine"):
        rank_laws(laws[2:], rows)


def test_a_field_that_the_rows_do_not_tell_is_refused():
    distances = np.linspace(1e-3, 5e-3, 15)
    with pytest.raises(FitError, match="two currents or more"):
        fit_sensed(distances, np.ones((15, 1)), distances, "B")
    d, currents = np.repeat(distances, 2), np.tile([[0.0, 0.0], [1.0, 1.0]], (15, 1))
    with pytest.raises(FitError, match="do not determine"):
        fit_sensed(d, currents, currents[:, 0], "B")


def test_rows_of_a_saturating_table_keep_what_it_holds():
    rows = rows_of_table(POT.table(SIX, WIDE))
    assert (rows.several, rows.linked.shape, rows.inductance.shape) == (False, (72, 1), (72, 1, 1))
    several = rows_of_table(table_of())
    assert (several.several, several.circuit_currents.shape) == (True, (81, 2))
    jitter = 1.0 + 1e-9 * np.random.default_rng(1).uniform(-1.0, 1.0, 81)  # settings that differ by rounding are one
    rounded = changed(lambda r: r.assign(distance_m=r["distance_m"] * jitter), table_of())
    alone = force_table(lambda d, i: 1e-6 * i**2 / d**2)  # an inductance without a flux linkage is not read
    assert rows_of_table(changed(lambda r: r.assign(inductance_H="see notes"), alone)).inductance is None
    np.testing.assert_allclose(rows_of_table(rounded).distances, DISTANCES, rtol=1e-8)
