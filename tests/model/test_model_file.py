"""The model file keeps every digit and says what is wrong with a damaged one."""

import copy
import json
from dataclasses import asdict, fields, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from femfit.core.errors import DomainError, MissingPartError, ModelFileError, OutputError
from femfit.device.electrics import Drive, ForceSensor
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.laws.catalogue import BUILT_IN
from femfit.model.actuator_model import ActuatorModel
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.json_file import model_from_dict, model_to_dict, read_model, write_model
from femfit.model.magnetics import Coefficient, LawMagnetics, Magnetics
from femfit.model.validity import ProcessNoise, ValidityBox
from support.eddies import with_eddies


@pytest.fixture
def law_model(levitation_model):
    coefficients = (
        Coefficient("d^-4", 0, 0.1 + 0.2, "N m^4", ci95=(1e-9, 2.0 / 3.0), bounds=(0.0, np.inf)),
        Coefficient("d^-2", 1, 4.51e-6, "N m^2/A", active="lower"),
    )
    magnetics = LawMagnetics("F1e", coefficients, {}, 0.0162, 1.0 / 3.0)
    return replace(levitation_model, magnetics=magnetics, covariance=np.diag([1e-20, 1.0 / 7.0]))


@pytest.fixture
def sprung_model(law_model):
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
    circuit = replace(law_model.circuit, drive=Drive(diode_V=0.7))
    return replace(law_model, motion=mechanics, circuits=(circuit,))


@pytest.fixture(params=["spline", "law", "sprung"])
def model(request, levitation_model, law_model, sprung_model):
    return {"spline": levitation_model, "law": law_model, "sprung": sprung_model}[request.param]


def test_writing_and_reading_keeps_every_digit(model, tmp_path):
    write_model(model, tmp_path / "model.json")
    again = read_model(tmp_path / "model.json")
    assert model_to_dict(again) == model_to_dict(model)
    d, i = np.linspace(0.015, 0.045, 50), np.linspace(0.0, 1.4, 50)
    np.testing.assert_array_equal(again.magnetics.force(d, i), model.magnetics.force(d, i))
    np.testing.assert_array_equal(again.sensor.voltage(d, i), model.sensor.voltage(d, i))
    assert again.misfit == model.misfit
    assert again.motion == model.motion
    assert again.circuit == model.circuit
    assert again.reference_distances_m == model.reference_distances_m
    assert [p.name for p in tmp_path.iterdir()] == ["model.json"]


@pytest.mark.parametrize("part", ["motion", "sensor", "misfit"])
def test_an_absent_part_stays_absent(model, tmp_path, part):
    write_model(replace(model, **{part: None}), tmp_path / "model.json")
    assert getattr(read_model(tmp_path / "model.json"), part) is None


@pytest.mark.parametrize("law", BUILT_IN, ids=lambda law: law.name)
def test_every_law_with_its_shape_parameters_survives_the_file(law, levitation_model):
    shape = {parameter.name: parameter.start for parameter in law.shape}
    magnetics = LawMagnetics(law.name, (Coefficient(law.basis[0], 0, 1e-9, law.coefficient_units[0]),), shape)
    again = model_from_dict(json.loads(json.dumps(model_to_dict(replace(levitation_model, magnetics=magnetics)))))
    assert again.magnetics.shape == shape
    assert again.magnetics.coefficients == magnetics.coefficients


def test_a_newer_schema_is_refused_with_both_numbers(model):
    data = model_to_dict(model) | {"schema": 99}
    with pytest.raises(ModelFileError, match=r"schema 99.*up to schema 3.*Update femfit"):
        model_from_dict(data, "m.json")


def test_a_pair_of_magnets_has_no_circuit_in_its_file_either(model):
    data = json.loads(json.dumps(model_to_dict(replace(model, circuits=()))))
    assert data["circuits"] == []
    assert model_from_dict(data).circuits == ()


@pytest.mark.parametrize("schema", [1, 2])
def test_a_file_of_earlier_schemas_has_its_circuits_under_two_keys(model, schema):
    data = model_to_dict(model)
    (one,) = data.pop("circuits")
    early = data | {"schema": schema, "further_circuits": []}
    assert model_from_dict(early | {"circuit": one}).circuits == model.circuits
    assert model_from_dict(early | {"circuit": None}).circuits == ()
    with pytest.raises(ModelFileError, match=r"circuits\[1\]\.colour"):
        model_from_dict(early | {"circuit": one, "further_circuits": [one | {"colour": "red"}]})
    with pytest.raises(ModelFileError, match="circuits must be a list"):
        model_from_dict(early | {"circuit": one, "further_circuits": 3})


def test_effects_that_are_not_known_are_refused(model):
    data = model_to_dict(model) | {"effects": [{"name": "eddy", "parameters": {}, "ci95": {}}]}
    with pytest.raises(ModelFileError, match=r"core_saturation.*'eddy'"):
        model_from_dict(data, "m.json")


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("motion", "mass_kg"), "4 g", r"motion\.mass_kg must be a finite number > 0; instead received '4 g'"),
        (("motion", "mass_kg"), 0, r"motion\.mass_kg must be a finite number > 0"),
        (("motion", "mass_kg"), True, r"motion\.mass_kg must be a finite number"),
        (("circuits", 0, "resistance_ohm"), None, r"circuits\[0\]\.resistance_ohm must be a finite number > 0"),
        (("circuits", 0, "voltage_max_V"), -1.0, r"circuits\[0\]\.voltage_max_V must be a finite number >= 0\.5"),
        (("circuits",), [{}], r"circuits\[0\]\.resistance_ohm must be a finite number > 0; it is missing"),
        (("circuits", 0, "colour"), "red", r"unknown key circuits\[0\]\.colour"),
        (("circuits", 0, "inductance_H"), -1.0, r"circuits\[0\]\.inductance_H must be a finite number >= 0"),
        (("circuits", 0, "drive"), {"kind": "voltage", "diode_V": -0.7}, r"drive\.diode_V must be .* >= 0"),
        (("circuits", 0, "drive"), {"kind": "current", "bandwidth_Hz": 0.0}, r"drive\.bandwidth_Hz must be .* > 0"),
        (("circuits", 0, "drive"), {"kind": "steam"}, r"drive\.kind must be voltage or current"),
        (("sensor", "adc_bits"), 12.5, r"sensor\.adc_bits must be a whole number"),
        (("sensor", "noise_V"), -1e-3, r"sensor\.noise_V must be a finite number >= 0"),
        (("sensor", "field", "coefficients"), [[1, 2], [3]], r"sensor\.field\.coefficients must be an array"),
        (("validity", "distance_max_m"), float("nan"), r"validity\.distance_max_m must be a finite number"),
        (("validity", "distance_min_m"), -0.01, r"d_0 / \(d \+ s\) of its magnetics must be finite"),
        (("validity", "distance_min_m"), 0.05, r"validity must span distances"),
        (("magnetics", "coordinate"), "angle", r"magnetics\.coordinate must be inverse_distance or distance"),
        (("magnetics", "colour"), "red", r"unknown key magnetics\.colour"),
        (("sample_time_s",), 0.0, r"sample_time_s must be a finite number > 0"),
        (("sample_time_s",), 10**400, r"sample_time_s must be a finite number > 0"),
        (
            ("magnetics", "kind"),
            "neural",
            r"magnetics\.kind must be coenergy_spline.* or law; instead received 'neural'",
        ),
        (("schema",), None, "must be a femfit model file"),
        (("schema",), True, "must be a femfit model file"),
    ],
)
def test_a_damaged_value_is_named_by_its_key_path(levitation_model, keys, value, message):
    data = copy.deepcopy(model_to_dict(levitation_model))
    place = data
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    with pytest.raises(ModelFileError, match=message):
        model_from_dict(data, "m.json")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("u_knots", [1.0, 0.5], r"magnetics\.u_knots must be ascending, with 5 equal knots"),
        ("u_degree", 0, r"magnetics\.u_degree must be a whole number in 1\.\.9"),
        ("coefficients", [[1.0]], r"magnetics\.coefficients must be 10 lists of 3 numbers"),
        ("reference_distance_m", 0.0, r"magnetics\.reference_distance_m must be a finite number > 0"),
        ("distance_shift_m", -1e-3, r"magnetics\.distance_shift_m must be a finite number >= 0"),
    ],
)
def test_a_damaged_spline_is_named_by_its_key_path(levitation_model, key, value, message):
    data = model_to_dict(levitation_model)
    data["magnetics"][key] = value
    with pytest.raises(ModelFileError, match=message):
        model_from_dict(data, "m.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"law": "F99"}, r"Force law must be one of F1e.*'F99'"),
        ({"coefficients": []}, r"magnetics\.coefficients must be a list of objects, at least one"),
        ({"shape": {"exponent": 3.0}}, r"unknown key magnetics\.shape\.exponent"),
    ],
)
def test_a_damaged_law_is_named(law_model, change, message):
    data = model_to_dict(law_model)
    data["magnetics"] |= change
    with pytest.raises(ModelFileError, match=message):
        model_from_dict(data, "m.json")


@pytest.mark.parametrize("key", ["coil_temperature_C", "magnet_temperature_C"])
def test_a_model_below_absolute_zero_is_refused(law_model, key):
    data = model_to_dict(law_model) | {key: -300.0}
    with pytest.raises(ModelFileError, match=rf"{key} must be a finite number >= -273\.15"):
        model_from_dict(data, "m.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"basis": "d^-9"}, r"coefficients\[0\]\.basis must be a column of the law \(d\^-4, d\^-2\)"),
        ({"current_power": -1}, r"coefficients\[0\]\.current_power must be a whole number"),
        ({"bounds": [0.0]}, r"coefficients\[0\]\.bounds must be a pair"),
        ({"ci95": ["a", "b"]}, r"coefficients\[0\]\.ci95 must be an array"),
    ],
)
def test_a_damaged_coefficient_is_named(law_model, change, message):
    data = model_to_dict(law_model)
    data["magnetics"]["coefficients"][0] |= change
    with pytest.raises(ModelFileError, match=message):
        model_from_dict(data, "m.json")


def test_values_that_overflow_in_the_box_are_refused(levitation_model):
    data = model_to_dict(levitation_model)
    data["magnetics"]["coefficients"][0] = [1e308, -1e308, 1e308]
    with pytest.raises(ModelFileError, match="finite"):
        model_from_dict(data, "m.json")


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", '{"schema": 1}', "distance_m,force_N\n1,2\n", "\ud83d", "[" * 100_000]
)
def test_a_file_that_is_no_model_is_refused(tmp_path, text):
    file = tmp_path / "model.json"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(ModelFileError, match=r"model\.json"):
        read_model(file)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ModelFileError, match="cannot be read: No such file"):
        read_model(tmp_path / "absent.json")


def test_a_model_that_json_cannot_hold_is_refused_and_the_old_file_kept(model, tmp_path):
    write_model(model, tmp_path / "model.json")
    before = (tmp_path / "model.json").read_text()
    for broken in (
        replace(model, sample_time_s=float("nan")),
        replace(model, provenance={"when": object()}),
    ):
        with pytest.raises(ModelFileError, match="cannot be written as JSON"):
            write_model(broken, tmp_path / "model.json")
    assert (tmp_path / "model.json").read_text() == before
    assert [p.name for p in tmp_path.iterdir()] == ["model.json"]


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def all_places(value, place=()):
    """Key paths of every member of nested JSON."""
    yield place
    members = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, member in members:
        yield from all_places(member, (*place, key))


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data(), junk=JSON_VALUES, delete=st.booleans())
def test_any_mutation_gives_a_model_or_one_clear_error(model, data, junk, delete):
    """A mutated member either is refused as damaged or is a value that the model may have."""
    mutated = model_to_dict(model)
    *parents, last = data.draw(st.sampled_from([p for p in all_places(mutated) if p]))
    place = mutated
    for key in parents:
        place = place[key]
    if delete:
        del place[last]
    else:
        place[last] = junk
    try:
        again = model_from_dict(mutated, "m.json")
    except ModelFileError:
        return
    assert np.isfinite(again.magnetics.force(np.asarray(0.02), np.asarray(0.5)))
    numbers = [value for part in (again.circuit, again.motion) if part for value in flat(asdict(part))]
    assert all(
        isinstance(value, float)
        for value in numbers
        if value is not None and value not in {"voltage", "current", "coil"}
    )


def flat(value):
    """All values of nested mappings and sequences."""
    if not isinstance(value, dict | tuple):
        return [value]
    return [one for member in (value.values() if isinstance(value, dict) else value) for one in flat(member)]


@pytest.mark.parametrize("drive", [Drive("current"), Drive("current", None, -1.0, 2.0, 500.0), Drive(diode_V=24.7)])
def test_what_feeds_the_winding_survives_the_file(levitation_model, drive):
    model = replace(levitation_model, circuits=(replace(levitation_model.circuit, drive=drive),))
    assert model_from_dict(json.loads(json.dumps(model_to_dict(model)))).circuit.drive == drive


def test_a_file_of_a_hanging_body_is_what_it_was(levitation_model):
    data = model_to_dict(levitation_model)
    assert data["motion"] == {"mass_kg": 4.35e-3, "gravity_m_s2": 9.80665}
    assert set(data["circuits"][0]) == {"resistance_ohm", "voltage_min_V", "voltage_max_V"}


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("springs", [{"stiffness": 3.0}], r"unknown key motion.springs\[0\].stiffness"),
        ("springs", [{"distances_m": [0.0, 0.0], "forces_N": [1.0, 2.0]}], "ascending"),
        ("springs", [{"distances_m": [0.0, 1.0], "forces_N": [1.0]}], "2 forces"),
        ("coulomb_N", -1.0, "motion.coulomb_N must be a finite number >= 0"),
        ("near_stop", {"distance_m": 0.05}, "at a larger distance than near_stop"),
        ("far_stop", {"distance_m": 0.05, "restitution": 1.5}, "0 to 1"),
        ("far_stop", {"distance_m": 0.05, "stiffness_N_per_m": 0.0}, "> 0"),
    ],
)
def test_damaged_mechanics_are_refused_by_their_key(sprung_model, key, value, message):
    data = model_to_dict(sprung_model)
    data["motion"][key] = value
    with pytest.raises(ModelFileError, match=message):
        model_from_dict(data, "m.json")


def test_every_field_of_the_model_is_written(model):
    worked_out = {"base", "dynamics", "conditions"}  # the file holds the base itself
    names = {field.name for field in fields(ActuatorModel)} - worked_out
    drawn = DrawnEffect("coil.r_mm[1]", (), "coil.r_mm[1]", 20.0, "mm", 0.1, ())
    model = replace(model, other_sensors=(ForceSensor(name="cell"),), process_noise=ProcessNoise(1e-3), drawn=(drawn,))
    model = with_eddies(model)
    assert set(model_to_dict(model)) == {"schema", *names}


def test_a_dimension_can_be_read_on_the_part_and_a_permeability_or_a_place_inside_a_sensor_cannot():
    coil = DrawnEffect("coil.r_mm[1]", (), "coil.r_mm[1]", 20.0, "mm", 0.1, ())
    (micrometer,) = coil.effect.calibrations
    assert micrometer.reads == {coil.parameter: pytest.approx(0.01)}
    assert "coil.r_mm[1]" in micrometer.instruction
    assert not replace(coil, key="hall.z_mm").effect.calibrations
    assert not replace(coil, key="materials.steel.relative_permeability", unit="").effect.calibrations


BOX = ValidityBox(0.015, 0.045, 0.0, 1.4)


@pytest.mark.parametrize(
    ("distance", "current", "inside"),
    [
        (0.015, 0.0, True),
        (0.045, 1.4, True),
        (0.015 - 1e-12, 0.0, True),
        (0.0149, 0.5, False),
        (0.0451, 0.5, False),
        (0.02, -0.01, False),
        (0.02, 1.41, False),
        (np.nan, 0.5, False),
        (0.02, np.nan, False),
        (np.inf, 0.5, False),
    ],
)
def test_the_validity_box_holds_its_edges_and_no_nan(distance, current, inside):
    assert bool(BOX.contains(np.asarray(distance), np.asarray(current))) is inside


def test_a_point_outside_of_the_box_is_refused_with_the_range_in_mm():
    BOX.require(np.array([0.02, 0.03]), np.asarray(0.5))
    with pytest.raises(DomainError, match=r"15\.\.45 mm and 0\.\.1\.4 A.*received 60 mm and 0\.5 A"):
        BOX.require(np.array([0.02, 0.06]), np.asarray(0.5))
    with pytest.raises(DomainError, match="received nan mm"):
        BOX.require(np.asarray(np.nan), np.asarray(0.5))


def test_a_model_of_forces_alone_has_no_dynamics(law_model):
    law_model.require_dynamics()
    forces_alone = replace(law_model, magnetics=replace(law_model.magnetics, constant_inductance_H=0.0))
    with pytest.raises(MissingPartError, match=r"inductance > 0.*--inductance-H"):
        forces_alone.require_dynamics()


def test_a_model_kind_without_a_file_form_is_refused(levitation_model, tmp_path):
    class Other(Magnetics):
        def _derivatives(self, distance, current, orders):  # noqa: ARG002  # as the base asks
            return [np.zeros_like(distance) for _ in orders]

    with pytest.raises(ModelFileError, match="it is Other"):
        write_model(replace(levitation_model, magnetics=Other()), tmp_path / "m.json")


def test_a_shifted_coordinate_survives_its_file_and_old_files_have_none(levitation_model):
    sensor = levitation_model.sensor
    shifted = replace(
        levitation_model,
        magnetics=replace(levitation_model.magnetics, coordinate=DistanceCoordinate(0.015, 2e-3)),
        sensor=replace(sensor, field=replace(sensor.field, coordinate=DistanceCoordinate(0.015, 3e-3))),
    )
    data = model_to_dict(shifted)
    again = model_from_dict(data, "m.json")
    assert again.magnetics.coordinate == DistanceCoordinate(0.015, 2e-3)
    assert again.sensor.field.coordinate == DistanceCoordinate(0.015, 3e-3)
    del data["magnetics"]["distance_shift_m"], data["magnetics"]["coordinate"]
    assert model_from_dict(data | {"schema": 1}, "m.json").magnetics.coordinate == DistanceCoordinate(0.015)


def test_a_model_replaces_a_model_but_no_other_file(levitation_model, tmp_path):
    (tmp_path / "mine.csv").write_text("a,b\n1,2\n")
    with pytest.raises(OutputError, match=r"mine\.csv"):
        write_model(levitation_model, tmp_path / "mine.csv")
    assert (tmp_path / "mine.csv").read_text() == "a,b\n1,2\n"
    for _ in range(2):
        write_model(levitation_model, tmp_path / "model.json")
