"""``docs/validation.md`` from the cases: ``cd tests && python -m support.validation_page`` writes it again."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from support import eddy_cases as eddies
from support import falling_magnet as fall
from support import pot_transfers as pot
from support import published_fea as published
from support import validation_cases as cases
from support.eddy_transient import pot_step
from support.exact import axis_field_of_cylinder

PAGE = Path(__file__).parents[2] / "docs" / "validation.md"
DIGITS = 6

ANALYTIC = "test_magnetostatic_analytic.py"
MEASURED = "test_magnetostatic_measured.py"
PAGE_TEST = "test_validation_page.py"
NONLINEAR = "test_nonlinear_field.py"

COILS = "test_coils_and_circuits.py"
KINDS = "test_device_kinds.py"
CONSISTENCY = "test_force_consistency.py"
PUBLISHED = "test_published_fea.py"
EDDIES = "test_eddy_closed_forms.py"
TRANSIENTS = "test_eddy_transients.py"


@dataclass(frozen=True)
class Row:
    """One line of the page.

    ``reference`` is None where the number is itself a difference; ``bound`` is what the test allows of the relative
    error; ``cheap`` rows that no other test computes are computed again in every run of the tests, the others with
    ``-m nightly``.
    """

    section: str
    case: str
    source: str
    unit: str
    reference: float | Callable[[], float] | None
    ours: Callable[[], float]
    bound: float
    test: str = PAGE_TEST
    cheap: bool = True

    @property
    def default(self) -> bool:
        """Whether every run of the tests computes it again for the page."""
        return self.cheap and self.test == PAGE_TEST


EXACT, ON_BENCH, PEERS, ITSELF = "Closed forms", "Measured", "Another solver", "Against itself"
PRINTED = "Finite elements that others printed"
INDUCED = "Eddy currents"


def rows() -> list[Row]:
    """Every line of the page."""
    return [
        *_coils(),
        *_magnets(),
        *_fields(),
        *_eddies(),
        *_reduced(),
        *_transients(),
        *_measured(),
        *_peers(),
        *_printed(),
        *_itself(),
    ]


def _part(k: int, case: Callable[..., tuple[float, ...]], *arguments: float) -> Callable[[], float]:
    return lambda: float(case(*arguments)[k])


def _coils() -> Iterator[Row]:
    for a, b, z in ((0.1, 0.1, 0.1), (0.1, 0.05, 0.05), (0.02, 0.015, 0.01), (0.25, 0.2, 0.1), (0.01, 0.0055, 0.015)):
        mutual, slope = cases.loops_exact(a, b, z)
        name, source = f"loops of {1e3 * a:g} and {1e3 * b:g} mm, {1e3 * z:g} mm apart", "elliptic integrals (Maxwell)"
        yield Row(EXACT, f"{name}: M", source, "H", mutual, _part(0, cases.loops, a, b, z), 2e-4)
        yield Row(EXACT, f"{name}: dM/dz", source, "H/m", slope, _part(1, cases.loops, a, b, z), 5e-4)
    for a, b, z in ((0.1, 0.05, 0.05), (0.02, 0.015, 0.01)):
        mutual, slope = cases.loops_exact(a, b, z)
        name = f"a fixed coil of {1e3 * a:g} mm and a moving one of {1e3 * b:g} mm, {1e3 * z:g} mm apart"
        source = "elliptic integrals (Maxwell)"
        yield Row(EXACT, f"{name}: M", source, "H", mutual, _part(0, cases.two_coils, a, b, z), 2e-4, COILS)
        yield Row(EXACT, f"{name}: force at 1 A", source, "N", -slope, _part(1, cases.two_coils, a, b, z), 5e-4, COILS)
    for length, henry in ((2.0, 1.3588917590e-6), (1.0, 2.0746304193e-6), (0.5, 2.8853346103e-6)):
        name = f"thin solenoid, radius 1 m, length {length:g} m: L / N²"
        yield Row(EXACT, name, "Lyle, Nagaoka", "H", henry, partial(cases.solenoid, length), 5e-4, cheap=False)
    name, henry = "Brooks coil of 10 mm: L / N²", 0.025491e-6
    yield Row(EXACT, name, "Grover's table", "H", henry, cases.brooks, 5e-4, ANALYTIC)
    finer = partial(cases.brooks, cases.FINER)
    yield Row(EXACT, f"{name}, ten times finer", "Grover's table", "H", henry, finer, 5e-5, ANALYTIC)
    name, source = "LDX, coil on coil: mass carried", "published, filaments (inductance)"
    yield Row(EXACT, name, source, "kg", 589.2638, cases.ldx_mass, 5e-4)


def _magnets() -> Iterator[Row]:
    pairs = (
        ((0.02, 0.04), (0.02, 0.04), 0.01, 265.537),
        ((0.02, 0.04), (0.015, 0.03), 0.015, 111.49),
        ((0.02, 0.02), (0.02, 0.01), 0.035, 18.953),
    )
    for fixed, moving, gap, newton in pairs:
        bodies = " and ".join(f"R{1e3 * radius:g} h{1e3 * height:g}" for radius, height in (fixed, moving))
        name = f"magnets {bodies} mm, gap {1e3 * gap:g} mm: force"
        ours = partial(cases.magnet_pair, 1.3, fixed, moving, gap)
        yield Row(EXACT, name, "published, magcode repository", "N", newton, ours, 2e-4)
    for offset in (0.005, 0.01, 0.015, 0.02, 0.03, 0.04):
        newton = float(cases.coil_on_magnet_exact(offset))
        name = f"coil R20 h20 mm of 100 A on a magnet R15 h15 mm, {1e3 * offset:g} mm off centre: force"
        ours, cheap = partial(cases.coil_on_magnet, offset), offset in (0.005, 0.03)
        yield Row(EXACT, name, "current sheet in magpylib's field", "N", newton, ours, 3e-4, cheap=cheap)
    for height in (0.001, 0.005, 0.01, 0.015, 0.02, 0.045):
        tesla = axis_field_of_cylinder(1.44, 0.0055, 0.005, height)
        name = f"magnet 11 mm x 5 mm, on the axis {1e3 * height:g} mm off: B"
        yield Row(EXACT, name, "closed form", "T", tesla, partial(cases.axis_field, height), 2e-4, ANALYTIC)
    for height in (0.002, 0.012, -0.01):
        tesla = cases.radial_ring_exact(height)
        name = f"ring of 8 to 15 mm magnetised radially, on the axis at {1e3 * height:g} mm: B"
        yield Row(EXACT, name, "closed form", "T", tesla, partial(cases.radial_ring, height), 3e-4, KINDS)


def _fields() -> Iterator[Row]:
    name, exact = "dipole before a plate: F d⁴", cases.image_of_a_dipole_exact()
    yield Row(EXACT, name, "image, 3 µ₀ m² / (32 π)", "N m⁴", exact, cases.image_of_a_dipole, 1e-4)
    for mu in (2, 10, 100, 1000):
        ours = partial(cases.ball, mu)
        yield Row(EXACT, f"sphere of µr {mu}: B / B₀", "3 µr / (µr + 2)", "", cases.sphere_exact(mu), ours, 1e-8)
    ratio = 0.05 / 0.055
    for mu in (100, 1000, 10000):
        name, ours = f"shell of µr {mu}, 50 to 55 mm: H / H₀ inside", partial(cases.ball, mu, ratio)
        yield Row(EXACT, name, "closed form", "", cases.shell_exact(mu, ratio), ours, 1e-8)


def _eddies() -> Iterator[Row]:
    for case in eddies.KNOWN:
        for metal, body in (("copper", eddies.COPPER), ("steel", eddies.STEEL)):
            for frequency in (1e3, 1e5):
                name, source = f"{case.name.format(metal)}, {frequency / 1e3:g} kHz", case.source
                exact, ours = (partial(one, case, body, frequency) for one in (eddies.exact, eddies.solved))
                cheap = frequency > 1e3
                yield Row(INDUCED, f"{name}: R", source, "ohm", exact()[0], _part(0, ours), 1e-3, EDDIES, cheap)
                yield Row(INDUCED, f"{name}: L", source, "H", exact()[1], _part(1, ours), 1e-3, EDDIES, cheap)


def _reduced() -> Iterator[Row]:
    source = "direct solution, one order finer"
    for k, (kind, unit) in enumerate(pot.KINDS.items()):
        for j, distance in enumerate(pot.DISTANCES_MM):
            for i, frequency in enumerate(pot.FREQUENCIES_HZ):
                exact, ours = (partial(lambda *at: float(abs(pot.both()[at])), k, side, j, i) for side in (0, 1))
                name = f"solid pot, {distance:g} mm, {frequency:g} Hz: {kind}"
                yield Row(INDUCED, name, source, unit, exact, ours, 0.01, cheap=False)
        name = f"solid pot, 8 states, 1 Hz to 10 kHz: {kind}, with its phase"
        yield Row(INDUCED, name, source, "", None, partial(pot.off, kind), 0.01, cheap=False)


def _transients() -> Iterator[Row]:
    for radius, source, exact, bound in (
        (0.002, "dipole, 45 µ₀² p² σ w / (1024 a⁴)", fall.braking_of_dipole, 3e-3),
        (0.004, "its rings in magpylib's field", fall.braking_of_cylinder, 5e-4),
    ):
        name, ours = f"magnet R{1e3 * radius:g} mm in a copper tube: braking", partial(fall.braking_of_field, radius)
        yield Row(INDUCED, name, source, "N s/m", exact(radius), ours, bound, TRANSIENTS)
    speed = fall.MASS * fall.GRAVITY / fall.braking_of_cylinder(fall.RADIUS)
    name, source = "the larger one falls, simulated: velocity", "weight over that braking"
    yield Row(INDUCED, name, source, "m/s", speed, fall.speed, 2e-3, TRANSIENTS, cheap=False)
    name, source = "step of voltage on a solid pot: current, at any time", "time steps of the field"
    yield Row(INDUCED, name, source, "", None, lambda: pot_step()[1], 0.01, TRANSIENTS, cheap=False)


def _measured() -> Iterator[Row]:
    name, source, newton = "TEAM problem 23, 50 mA: force", "measured 1.15 gf (Ansys VM270)", 11.28e-3
    recoil = partial(cases.team_23, cases.team_23_recoil())
    yield Row(ON_BENCH, f"{name}, µ = Br / (µ₀ Hc)", source, "N", newton, recoil, 0.01, MEASURED)
    yield Row(ON_BENCH, f"{name}, µr = 1", source, "N", newton, partial(cases.team_23, 1.0), 0.07, MEASURED)
    for gap, kilogram in ((0.01, 30.0), (0.02, 15.0), (0.04, 5.0)):
        name = f"two magnets S-45-30-N, {1e3 * gap:g} mm apart: pull"
        ours = partial(cases.large_magnets, gap)
        yield Row(ON_BENCH, name, "maker's figure, whole kg", "kg", kilogram, ours, 0.06, MEASURED)


def _peers() -> Iterator[Row]:
    source = "xfemm, first-order elements"
    tables = (("", "up to 3 A", 0.01), ("_fine", "up to 3 A, its finer mesh", 0.01), ("_saturated", "4 to 12 A", 0.04))
    for table, words, bound in tables:
        for worst in (False, True):
            which = "largest" if worst else "median"
            name = f"steel disc before a steel core, {words}: {which} difference of the force"
            ours = partial(cases.difference_from_peer, f"steel_xfemm{table}.csv", worst)
            yield Row(PEERS, name, source, "", None, ours, bound, NONLINEAR, cheap=False)


def _printed() -> Iterator[Row]:
    source = "Modelica, SolenoidActuator"
    for gap, (newton, henry) in published.LIFTING_MAGNET.items():
        name, ours = f"lifting magnet, gap {gap:g} mm, 1.2 A", partial(published.lifting_magnet, gap)
        cheap = gap == 0.25  # the most saturated
        yield Row(PRINTED, f"{name}: pull", source, "N", newton, _part(0, ours), 0.025, cheap=cheap)
        yield Row(PRINTED, f"{name}: flux linkage / i", source, "H", henry, _part(1, ours), 0.011, cheap=cheap)
    source = "Modelica, MovingCoilActuator"
    for distance, (newton, henry) in published.MOVING_COIL.items():
        name, ours = f"moving coil, x = {-16.0 - distance:g} mm", partial(published.moving_coil, distance)
        cheap = distance == min(published.MOVING_COIL)
        yield Row(PRINTED, f"{name}: force at -3 A", source, "N", newton, _part(0, ours), 8e-3, cheap=cheap)
        yield Row(PRINTED, f"{name}: inductance", source, "H", henry, _part(2, ours), 0.013, cheap=cheap)
    name, newton = "moving coil, x = 0 mm: force at 3 A", published.MOVING_COIL_ATTRACTED
    yield Row(PRINTED, name, source, "N", newton, _part(1, published.moving_coil, -16.0), 5e-3, PUBLISHED)


def _itself() -> Iterator[Row]:
    linear, saturated = ("rig, 20 mm, 1 A", cases.linear_rig), ("saturated steel disc, 4 mm, 8 A", cases.saturated_disc)
    for name, case in (linear, saturated):
        test, cheap = (CONSISTENCY, True) if case is cases.linear_rig else (NONLINEAR, False)
        force = (f"{name}: F and -dW'/dd", "virtual work", "N", _part(1, case), _part(0, case), 2e-3)
        constant = (f"{name}: dF/di and -dψ/dd", "reciprocity", "N/A", _part(3, case), _part(2, case), 5e-3)
        for row in (force, constant):
            yield Row(ITSELF, *row, test, cheap)


HEAD = """# Validation

What the field solver gives for problems whose answer is known. The numbers are written by
`cd tests && python -m support.validation_page`; `tests/physics/test_validation_page.py` computes them again (all of
them with `-m nightly`) and fails when this page says anything else. Settings are the defaults unless a line says so.

What the lines can prove: a closed form proves the last digit printed. The maker's figures are whole kilograms of
unstated remanence (1.32 T is taken), so 4 % is agreement. One measured point of TEAM 23 cannot tell a wrong
permeability from a gap that is 0.05 mm off: with µr = 1 it misses by 6 %, with the recoil permeability that its Br and
Hc give by less than 1 %. The peer's tables carry the peer's own mesh error, seen in the disagreement of its two bodies
(3 to 8 %). The printed finite elements come with every dimension of the lifting magnet but those of its winding, and of
the moving coil without the height and section of the coil and the bottom of the yoke: what is taken for them stands in
`tests/support/published`. Coils of 8 to 14 mm move the force in the middle by 1 %; 12 mm gives the fall of the force
towards the ends of the travel. The force that was printed for the lifting magnet scatters by up to 1.6 % round a
smooth curve through all of its 20 gaps, and the steel's curve is its library's formula, not the points that the formula
was fitted to.

Eddy currents: copper of 58 MS/m, steel of 6 MS/m and µr 100; R and L are what the body adds to a coil of 100 turns, of
the round core all that the coil has but the resistance of its wire. The bodies stand in `tests/support/eddy_cases.py`.
The plate is as thick as the closed form's and five times as wide as the coil, whose field its edge cuts off by 0.04 %
beside steel at 1 kHz; the rod is 0.4 m long; the core stands in iron of µr 10⁸, which makes its field that of an
endless solenoid to 10⁻⁶. Sheets are not in the list: `lamination_mm` is the first term of homogenisation, which is met
to 10⁻⁵ and differs from the sheet's own tanh by (b / δ)⁴ / 180 of the impedance: by 0.03 % where a sheet's thickness b
is half of the skin depth δ, by 1 % where it is 1.17 of it.

The solid pot is `geometry/pot-magnet.toml`, swept and fitted as it is: its model keeps 8 states. Amplitudes are of
small currents about 1 A; 1.75 mm lies between two distances of the sweep.

Eddy currents in time go from the drawing through sweep and model to the simulation. The tube is of copper, 8 to 10 mm
in radius; its magnets are cylinders of 1.3 T, √3 times as high as their radius. The dipole's line shows what a
magnet's size is worth. The model's braking coefficient lies within 0.25 % of the closed form everywhere between the
sweep's distances, and at constant velocity the eddy currents' power is that of the weight to 0.1 %. The pot's winding
gets its step between two distances of the sweep, from 1 µs to 0.1 s, in parts of the current's final value; half the
time steps change the field's own answer by 0.07 %. At 1 mm on `geometry/pot-magnet.toml` the model of 8 states is
0.17 % off in the current, and 0.06 % in the flux linkage; its time steps are good for 0.02 %.
"""


COLUMNS = "| case | reference is | unit | reference | femfit | error | also in |\n|---|---|---|---:|---:|---:|---|"


def reference_of(row: Row) -> float | None:
    """What a line is compared with; None where the number is itself a difference."""
    return row.reference() if callable(row.reference) else row.reference


def cells_of(row: Row, ours: float) -> list[str]:
    """The cells of a line; the error is that of the value as printed."""
    reference = reference_of(row)
    if reference is None:
        return [row.case, row.source, row.unit, "", f"{100.0 * ours:.2f} %", "", row.test]
    printed = _number(ours)
    error = f"{100.0 * (float(printed) / reference - 1.0):+.4f} %"
    return [row.case, row.source, row.unit, _number(reference), printed, error, row.test]


def _number(value: float) -> str:
    return f"{value:.{DIGITS - 1}e}" if abs(value) < 1e-3 else f"{value:.{DIGITS}g}"


def render() -> str:
    """The page, everything computed."""
    parts, section = [HEAD], ""
    for row in rows():
        if row.section != section:
            section = row.section
            parts.append(f"\n## {section}\n\n{COLUMNS}")
        parts.append(f"| {' | '.join(cells_of(row, row.ours()))} |")
    return "\n".join(parts).replace("\n\n\n", "\n\n") + "\n"


if __name__ == "__main__":
    PAGE.write_text(render(), encoding="utf-8")
