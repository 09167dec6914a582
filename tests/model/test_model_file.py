"""The model file keeps every digit of every kind of model and says what is wrong with a damaged one."""

import json
import pickle
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import pytest

from femfit.core.errors import ModelFileError, OutputError
from femfit.device.electrics import Drive
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.effects.effect import AddedEffect
from femfit.laws.catalogue import BUILT_IN
from femfit.model.actuator_model import ActuatorModel
from femfit.model.bspline import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.eddy_currents import EddyBias
from femfit.model.json_file import model_from_dict, model_to_dict, read_model, write_model
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.validity import ActuatorKind, ProcessNoise
from femfit.model.with_effects import with_effects
from support.added_effects import added
from support.closed_forms import fit_of
from support.eddies import with_eddies
from support.impedances import with_drawn_conductivity
from support.model_kinds import KINDS, law_model, states_of
from support.readings import EVERY_SENSOR
from support.solenoids import searched

KIND = ActuatorKind(False, True, True, False, True, False)
BIAS = EddyBias(np.array([0.015, 0.045]), np.array([[0.4], [1.0]]), ("core",))


def every_spring(rig):
    """With every kind of spring, both stops, friction, a load and a diode."""
    mechanics = Mechanics(
        0.1 + 0.2,
        -9.81,
        springs=(Spring(1.0 / 3.0, -0.7, 0.02), ForceTable((0.01, 0.03), (0.1, -0.2 / 3.0))),
        viscous_N_s_per_m=0.3,
        coulomb_N=0.01,
        load_N=-0.2,
        near_stop=Stop(0.016, 0.3, 1e5),
        far_stop=Stop(0.044),
    )
    law = law_model(rig)
    return replace(law, motion=mechanics, circuits=(replace(law.circuit, drive=Drive(diode_V=0.7)),))


def of_law(law):
    shape = {parameter.name: parameter.start for parameter in law.shape}
    return LawMagnetics(law.name, (Coefficient(law.basis[0], 0, 1e-9, law.coefficient_units[0]),), shape)


def biased(rig):
    eddied = with_eddies(rig)
    return replace(eddied, eddy=replace(eddied.eddy, bias=BIAS))


def shifted(rig):
    magnetics = replace(rig.magnetics, coordinate=DistanceCoordinate(0.015, 2e-3))
    field = replace(rig.sensor.field, coordinate=DistanceCoordinate(0.015, 3e-3))
    return replace(rig, magnetics=magnetics, sensor=replace(rig.sensor, field=field))


def conducting(rig):
    model = with_drawn_conductivity(rig)
    return with_effects(model, [AddedEffect(model.drawn[0].effect, {"change": 0.05})])


def of_drawn_dimension(_):
    """With every number of its drawing, one of which is off."""
    model = read_model(Path(__file__).parents[1] / "golden/inputs/models/rig.json")
    return with_effects(model, [AddedEffect(model.drawn[3].effect, {"change_mm": 0.05}, {"change_mm": (0.04, 0.06)})])


def driven(drive):
    return lambda rig: replace(rig, circuits=(replace(rig.circuit, drive=drive),))


FILED = KINDS | {
    "every spring": every_spring,
    "no motion": lambda rig: replace(rig, motion=None),
    "no sensor": lambda rig: replace(rig, sensor=None),
    "no misfit": lambda rig: replace(rig, misfit=None),
    "no circuit": lambda rig: replace(rig, circuits=()),
    "sensors": lambda rig: replace(rig, other_sensors=EVERY_SENSOR),
    "pickup coil": lambda _: searched(noise=1e-3),
    "kind": lambda rig: replace(rig, kind=KIND),
    "shifted": shifted,
    "biased eddies": biased,
    "drawn conductivity": conducting,
    "drawn dimension": of_drawn_dimension,
    "two circuits that saturate": lambda _: fit_of("two circuits that saturate").model,
    "amplifier": driven(Drive("current")),
    "fast amplifier": driven(Drive("current", None, -1.0, 2.0, 500.0)),
    "diode": driven(Drive(diode_V=24.7)),
    "turns": lambda _: with_effects(searched(), [added("turns", turns_error=0.1)]),
    "saturated coil": lambda _: with_effects(searched(), [added("core_saturation", mmf_loss_3=0.1)]),
    "interval": lambda rig: with_effects(rig, [
        replace(added("hall_offset", offset_V=0.02), ci95={"offset_V": (0.01, 0.03)}),
        added("core_saturation", mmf_loss_3=0.1, mmf_loss_6=0.02),
    ]),
} | {law.name: lambda rig, law=law: replace(rig, magnetics=of_law(law)) for law in BUILT_IN}  # fmt: skip


@pytest.fixture
def made(levitation_model, model_kind):
    return lambda name: model_kind(name) if name in KINDS else FILED[name](levitation_model)


@pytest.mark.parametrize("name", FILED)
def test_every_digit_survives_the_file_and_a_pickle(name, made, tmp_path):
    model = made(name)
    write_model(model, tmp_path / "model.json")
    read = read_model(tmp_path / "model.json")
    assert [path.name for path in tmp_path.iterdir()] == ["model.json"]
    states, _ = states_of(model, 9)
    for again in (read, pickle.loads(pickle.dumps(model))):  # noqa: S301  its own
        assert model_to_dict(again) == model_to_dict(model)
        for part in ("misfit", "motion", "circuits", "kind", "reference_distances_m", "state_names", "order"):
            assert getattr(again, part) == getattr(model, part)
        np.testing.assert_equal(asdict(again.validity), asdict(model.validity))
        assert [sensor.name for sensor in again.other_sensors] == [sensor.name for sensor in model.other_sensors]
        for beyond in (1.0, 20.0):  # of the currents that were swept
            currents = beyond * states[:, 2 : model.windings.end]
            forces = [side.windings.magnetics.force(states[:, 0], currents) for side in (again, model)]
            np.testing.assert_array_equal(*forces)
        if model.sensor and model.eddy is None:
            voltages = [side.sensor.voltage(states[:, 0], states[:, 2]) for side in (again, model) if side.circuits]
            assert not voltages or voltages[0].tolist() == voltages[1].tolist()


def test_every_field_of_the_model_is_written_and_no_part_that_it_lacks(levitation_model):
    worked_out = {"base", "dynamics", "conditions"}  # the file holds the base itself
    names = {field.name for field in fields(ActuatorModel)} - worked_out
    drawn = DrawnEffect("coil.r_mm[1]", "coil.r_mm[1]", "mm", 20.0, 0.1)
    model = replace(levitation_model, other_sensors=EVERY_SENSOR, process_noise=ProcessNoise(1e-3), drawn=(drawn,))
    assert set(model_to_dict(with_eddies(model))) == {"schema", *names}
    data = model_to_dict(levitation_model)
    assert data["motion"] == {"mass_kg": 4.35e-3, "gravity_m_s2": 9.80665}
    assert set(data["circuits"][0]) == {"resistance_ohm", "voltage_min_V", "voltage_max_V"}
    assert not {"eddy", "other_sensors"} & set(data)
    assert "bias" not in model_to_dict(with_eddies(levitation_model))["eddy"]
    assert model_to_dict(replace(levitation_model, circuits=()))["circuits"] == []


def test_files_of_earlier_schemas_are_read(levitation_model, made):
    halves = made("halves")
    data = model_to_dict(halves)
    first, further = data.pop("circuits")
    early = data | {"schema": 2, "circuit": first, "further_circuits": [further]}
    assert model_from_dict(early).circuits == halves.circuits
    data = model_to_dict(levitation_model)
    (circuit,) = data.pop("circuits")
    for schema in (1, 2):
        early = data | {"schema": schema, "further_circuits": []}
        assert model_from_dict(early | {"circuit": circuit}).circuits == levitation_model.circuits
        assert model_from_dict(early | {"circuit": None}).circuits == ()
        with pytest.raises(ModelFileError, match=r"circuits\[1\]\.colour"):
            model_from_dict(early | {"circuit": circuit, "further_circuits": [circuit | {"colour": "red"}]})
        with pytest.raises(ModelFileError, match="circuits must be a list"):
            model_from_dict(early | {"circuit": circuit, "further_circuits": 3})
    early = data | {"schema": 1, "circuit": circuit, "further_circuits": []}
    del early["magnetics"]["distance_shift_m"], early["magnetics"]["coordinate"]
    assert model_from_dict(early, "m.json").magnetics.coordinate == DistanceCoordinate(0.015)


def test_the_bias_of_eddy_currents_lies_between_its_distances_and_goes_with_the_ampere_turns(made):
    eddy = made("biased eddies").eddy
    assert eddy.bias.at(np.array([0.0, 0.03, 0.045]))[:, 0] == pytest.approx([0.4, 0.7, 1.0])
    assert eddy.scaled(1.0, np.array([1.25])).bias.current_A == pytest.approx(BIAS.current_A / 1.25)


MASS, CIRCUIT, EDDY = ("motion", "mass_kg"), ("circuits", 0), ("eddy",)
INNER = {"name": "inner", "resistance_ohm": 1.0, "voltage_min_V": 0.0, "voltage_max_V": 1.0}
COEFFICIENT, MAGNETICS, SENSOR = ("magnetics", "coefficients", 0), ("magnetics",), ("other_sensors",)

DAMAGES = [
    ("springs", MASS, "4 g", r"motion\.mass_kg must be a finite number > 0; instead received '4 g'"),
    ("springs", MASS, 1e-320, "mass_kg"),
    ("springs", ("provenance",), {"runs": [float("inf")]}, "provenance must be without numbers that are not finite"),
    ("one circuit", (*CIRCUIT, "resistance_ohm"), None, r"circuits\[0\]\.resistance_ohm must be a finite number > 0"),
    ("one circuit", ("circuits",), [{}], r"circuits\[0\].resistance_ohm must be given; it is missing"),
    ("one circuit", (*CIRCUIT, "colour"), "red", r"circuits\[0\]\.colour must be a key that there is"),
    ("one circuit", (*CIRCUIT, "drive"), {"kind": "voltage", "diode_V": -0.7}, r"drive\.diode_V must be .* >= 0"),
    ("one circuit", (*CIRCUIT, "drive"), {"kind": "steam"}, r"drive\.kind must be voltage or current"),
    ("halves", ("circuits", 1, "name"), "inner", "circuits"),
    ("halves", (*MAGNETICS, "circuits"), ["inner", "inner"], "circuits"),
    ("halves", (*MAGNETICS, "coefficients"), [[0.0]], r"magnetics\.coefficients"),
    ("halves", ("circuits",), [INNER], "of the same circuits"),
    ("two circuits that saturate", (*MAGNETICS, "circuits", 1, "degree"), 3, "knots_A"),
    ("one circuit", ("sensor", "adc_bits"), 12.5, r"sensor\.adc_bits must be a whole number"),
    ("one circuit", ("sensor", "field", "coefficients"), [[1, 2], [3]], r"field\.coefficients must be an array"),
    ("one circuit", ("validity", "distance_min_m"), 0.05, r"validity must span distances"),
    ("one circuit", (*MAGNETICS, "coordinate"), "angle", r"magnetics\.coordinate must be inverse_distance or distance"),
    ("one circuit", ("sample_time_s",), 10**400, r"sample_time_s must be a finite number > 0"),
    ("one circuit", (*MAGNETICS, "kind"), "neural", r"kind must be coenergy_spline.*instead received 'neural'"),
    ("one circuit", ("schema",), None, "must be a femfit model file"),
    ("one circuit", ("schema",), 99, r"schema 99.*up to schema 3.*Update femfit"),
    ("one circuit", ("effects",), [{"name": "eddy", "parameters": {}, "ci95": {}}], r"core_saturation.*'eddy'"),
    ("one circuit", (*MAGNETICS, "u_knots"), [1.0, 0.5], r"magnetics\.u_knots must be ascending, with 5 equal knots"),
    *(
        (
            "one circuit",
            (*MAGNETICS, "current_knots_A"),
            knots,
            r"current_knots_A must be ascending, with 3 equal knots",
        )
        for knots in ([0, 0, 0, 0.5, 0.5, 0.5, 1, 1, 1], [0, 0, 0, 0.7, 0.2, 1, 1, 1], [0, 0, 1, 1, 1], [0] * 6)
    ),
    ("drawn dimension", ("drawn", 0, "tolerance"), -1.0, r"drawn\[0\]\.tolerance must be a finite number > 0"),
    ("one circuit", (*MAGNETICS, "u_degree"), 0, r"magnetics\.u_knots must be ascending|whole number in 1\.\.9"),
    ("one circuit", (*MAGNETICS, "coefficients"), [[1.0]], r"coefficients must be 10 lists of 3 numbers"),
    ("one circuit", COEFFICIENT, [1e308, -1e308, 1e308], "finite"),
    ("law", (*MAGNETICS, "law"), "F99", r"Force law must be one of F1e.*'F99'"),
    ("law", (*COEFFICIENT, "basis"), "d^-9", r"coefficients\[0\]\.basis must be a column of the law \(d\^-4, d\^-2\)"),
    ("law", (*COEFFICIENT, "bounds"), [0.0], r"coefficients\[0\]\.bounds must be 2 numbers"),
    ("springs", ("motion", "far_stop"), {"distance_m": 0.05, "restitution": 1.5}, "<= 1"),
    ("every spring", ("motion", "near_stop"), {"distance_m": 0.05}, "at a larger distance than near_stop"),
    ("eddies", (*EDDY, "inductances_H", 0, 0), 1e308, "damaged: eddy.inductances_H"),
    ("eddies", (*EDDY, "inductances_H", 0, 0), -1.0, r"eddy.inductances_H must be .*positive definite"),
    ("eddies", (*EDDY, "resistances_ohm"), [1.0, -1.0, 1.0], "eddy.resistances_ohm must be .*numbers > 0"),
    ("eddies", (*EDDY, "circuits"), ["other"], "eddy.circuits must be .*those of the model"),
    ("eddies", (*EDDY, "couplings"), [[[1.0]]], "eddy.couplings must be .*as the knots and names beside it ask for"),
    ("eddies", (*EDDY, "names"), "eddy", "eddy.names must be .*list of names"),
    ("eddies", (*EDDY, "names"), ["eddy_1", "eddy_1", "eddy_2"], "eddy.names must be .*differ from each other"),
    ("biased eddies", (*EDDY, "bias", "distances_m"), [0.045, 0.015], "numbers that grow"),
    ("sensors", (*SENSOR, 0, "kind"), "search_coil", r"other_sensors\[\d\]\.kind"),
    ("sensors", (*SENSOR, 0, "name"), "laser", r"other_sensors\[\d\]\.name"),
]


@pytest.mark.parametrize(("name", "keys", "value", "message"), DAMAGES)
def test_a_damaged_value_is_named_by_its_key_path(made, name, keys, value, message):
    data = json.loads(json.dumps(model_to_dict(made(name))))
    place = data
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    with pytest.raises(ModelFileError, match=message):
        model_from_dict(data, "m.json")


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", '{"schema": 1}', "distance_m,force_N\n1,2\n", "\ud83d", "[" * 100_000]
)
def test_a_file_that_is_no_model_is_refused(tmp_path, text):
    file = tmp_path / "model.json"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(ModelFileError, match=r"model\.json"):
        read_model(file)


def test_a_model_that_json_cannot_hold_is_refused_and_only_a_model_is_replaced(levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    before = (tmp_path / "model.json").read_text()
    for change, words in (
        ({"sample_time_s": float("nan")}, "cannot be written as JSON"),
        ({"provenance": {"when": object()}}, "cannot be written as JSON"),
    ):
        with pytest.raises(ModelFileError, match=words):
            write_model(replace(levitation_model, **change), tmp_path / "model.json")
    assert (tmp_path / "model.json").read_text() == before
    assert [path.name for path in tmp_path.iterdir()] == ["model.json"]
    (tmp_path / "mine.csv").write_text("a,b\n1,2\n")
    with pytest.raises(OutputError, match=r"mine\.csv"):
        write_model(levitation_model, tmp_path / "mine.csv")
    assert (tmp_path / "mine.csv").read_text() == "a,b\n1,2\n"
    for _ in range(2):
        write_model(levitation_model, tmp_path / "model.json")


def test_a_dimension_can_be_read_on_the_part_and_a_permeability_or_a_place_inside_a_sensor_cannot():
    coil = DrawnEffect("coil.r_mm[1]", "coil.r_mm[1]", "mm", 20.0, 0.1)
    (micrometer,) = coil.effect.calibrations
    assert micrometer.reads == {coil.parameter: pytest.approx(0.01)}
    assert "coil.r_mm[1]" in micrometer.instruction
    assert not replace(coil, key="hall.z_mm").effect.calibrations
    assert not replace(coil, key="materials.steel.relative_permeability", unit="").effect.calibrations
