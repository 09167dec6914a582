"""The tables of ``docs/validation.md``: ``cd tests && python -m support.validation_page`` writes them again."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from femfit.core.numerics import MU_0
from femfit.device.load import read_actuator
from femfit.field.layout import layout_of
from femfit.field.point_rows import swept_currents
from femfit.field.problem import prepare
from femfit.field.tolerance import settings_for
from support import eddy_cases as eddies
from support import falling_magnet as fall
from support import pot_transfers as pot
from support import validation_cases as cases
from support.eddy_transient import pot_step
from support.field import prepared

PAGE = Path(__file__).parents[2] / "docs" / "validation.md"
DIGITS = 6


@dataclass(frozen=True)
class Row:
    """One line of the page.

    ``reference`` is None where the number is itself a difference; ``bound`` is what the test allows of the relative
    error; ``cheap`` rows are computed again in every run of the tests, the others with ``-m nightly``.
    """

    section: str
    case: str
    source: str
    unit: str
    reference: float | Callable[[], float] | None
    ours: Callable[[], float]
    bound: float
    cheap: bool = True


EXACT, ON_BENCH, PEERS = "Closed forms", "Measured", "Another solver"
PRINTED = "Finite elements that others printed"
INDUCED = "Eddy currents"


def rows() -> list[Row]:
    parts = (_coils, _magnets, _eddies, _transients, _measured, _printed)
    return [row for part in parts for row in part()]


def _part(k: int, case: Callable[..., tuple[float, ...]], *arguments: float) -> Callable[[], float]:
    return lambda: float(case(*arguments)[k])


def _coils() -> Iterator[Row]:
    for a, b, z in ((0.1, 0.1, 0.1), (0.1, 0.05, 0.05), (0.02, 0.015, 0.01)):
        mutual, slope = cases.loops_exact(a, b, z)
        name = f"a fixed coil of {1e3 * a:g} mm and a moving one of {1e3 * b:g} mm, {1e3 * z:g} mm apart"
        source = "elliptic integrals (Maxwell)"
        yield Row(EXACT, f"{name}: M", source, "H", mutual, _part(0, cases.two_coils, a, b, z), 2e-4)
        yield Row(EXACT, f"{name}: force at 1 A", source, "N", -slope, _part(1, cases.two_coils, a, b, z), 5e-4)
    name, source, henry = "Brooks coil of 10 mm: L / N²", "loops over its section", cases.brooks_exact()
    yield Row(EXACT, name, source, "H", henry, cases.brooks, 5e-4)
    yield Row(EXACT, f"{name}, ten times finer", source, "H", henry, partial(cases.brooks, cases.FINER), 5e-6)
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
    bodies, newton = ((0.02, 0.04), (0.02, 0.04), 0.01), 265.537
    name, ours = "opposed magnets R20 h40 mm, gap 10 mm: force", partial(cases.magnet_pair, -1.3, *bodies)
    yield Row(EXACT, name, "published, magcode repository", "N", -newton, ours, 2e-4)
    for mu in (5.0, 1000.0):
        name, ours = f"magnet R20 h40 mm 5 mm above a plate of µr {mu:g}", partial(cases.image_of_a_magnet, mu)
        exact = (mu - 1.0) / (mu + 1.0) * newton
        yield Row(EXACT, name, "its image 10 mm away, (µr - 1) / (µr + 1)", "N", exact, ours, 5e-4)
    for height in (-0.0125, 0.0, 0.02):
        name, exact = f"winding of the rig, on its axis at {1e3 * height:g} mm: B", cases.thick_coil_axis_exact(height)
        yield Row(EXACT, name, "closed form", "T", exact, partial(cases.thick_coil_axis, height), 1e-4)
    for offset in (0.005, 0.01, 0.015, 0.02, 0.03, 0.04):
        newton = float(cases.coil_on_magnet_exact(offset))
        name = f"coil R20 h20 mm of 100 A on a magnet R15 h15 mm, {1e3 * offset:g} mm off centre: force"
        ours, cheap = partial(cases.coil_on_magnet, offset), offset in (0.005, 0.03)
        yield Row(EXACT, name, "current sheet in magpylib's field", "N", newton, ours, 3e-4, cheap=cheap)
    for height in (0.001, 0.005, 0.01, 0.015, 0.02, 0.045):
        tesla = cases.axis_field_of_cylinder(1.44, 0.0055, 0.005, height)
        name = f"magnet 11 mm x 5 mm, on the axis {1e3 * height:g} mm off: B"
        yield Row(EXACT, name, "closed form", "T", tesla, partial(cases.axis_field, height), 2e-4)
    for height in (0.002, 0.012, -0.01):
        tesla = cases.radial_ring_exact(height)
        name = f"ring of 8 to 15 mm magnetised radially, on the axis at {1e3 * height:g} mm: B"
        yield Row(EXACT, name, "closed form", "T", tesla, partial(cases.radial_ring, height), 3e-4)
    for mu in (2, 10, 100, 1000):
        ours = partial(cases.ball, mu)
        yield Row(EXACT, f"sphere of µr {mu}: B / B₀", "3 µr / (µr + 2)", "", 3.0 * mu / (mu + 2.0), ours, 1e-8)
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
                yield Row(INDUCED, f"{name}: R", source, "ohm", exact()[0], _part(0, ours), 1e-3)
                yield Row(INDUCED, f"{name}: L", source, "H", exact()[1], _part(1, ours), 1e-3)
    for kind in pot.KINDS:
        name = f"solid pot, 8 states, 1 Hz to 10 kHz: {kind}, with its phase"
        source = "direct solution, one order finer"
        yield Row(INDUCED, name, source, "", None, partial(pot.off, kind), 0.01, cheap=False)


def _transients() -> Iterator[Row]:
    for radius, source, exact, bound in (
        (0.002, "dipole, 45 µ₀² p² σ w / (1024 a⁴)", fall.braking_of_dipole, 3e-3),
        (0.004, "its rings in magpylib's field", fall.braking_of_cylinder, 5e-4),
    ):
        name, ours = f"magnet R{1e3 * radius:g} mm in a copper tube: braking", partial(fall.braking_of_field, radius)
        yield Row(INDUCED, name, source, "N s/m", exact(radius), ours, bound)
    speed = fall.MASS * fall.GRAVITY / fall.braking_of_cylinder(fall.RADIUS)
    name, source = "the larger one falls, simulated: velocity", "weight over that braking"
    yield Row(INDUCED, name, source, "m/s", speed, fall.speed, 2e-3, cheap=False)
    name, source = "step of voltage on a solid pot: current, at any time", "time steps of the field"
    yield Row(INDUCED, name, source, "", None, lambda: pot_step()[1], 0.01, cheap=False)


def _measured() -> Iterator[Row]:
    name, source, newton = "TEAM problem 23, 50 mA: force", "measured 1.15 gf (Ansys VM270)", 11.28e-3
    recoil = partial(cases.team_23, 1.02 / (MU_0 * 720e3))  # from its remanence and coercive field
    yield Row(ON_BENCH, f"{name}, µ = Br / (µ₀ Hc)", source, "N", newton, recoil, 0.01)
    yield Row(ON_BENCH, f"{name}, µr = 1", source, "N", newton, partial(cases.team_23, 1.0), 0.07)
    source = "an independent quadrature"
    yield Row(ON_BENCH, f"{name}, µ = Br / (µ₀ Hc), computed", source, "N", 11.207e-3, recoil, 2e-3)
    yield Row(ON_BENCH, f"{name}, µr = 1, computed", source, "N", 11.925e-3, partial(cases.team_23, 1.0), 2e-3)
    for gap, kilogram in ((0.01, 30.0), (0.02, 15.0), (0.04, 5.0)):
        name = f"two magnets S-45-30-N, {1e3 * gap:g} mm apart: pull"
        pull = partial(cases.magnet_pair, 1.32, (0.0225, 0.03), (0.0225, 0.03), gap)  # N45
        yield Row(ON_BENCH, name, "maker's figure, whole kg", "kg", kilogram, lambda pull=pull: pull() / 9.80665, 0.06)
    source = "xfemm, first-order elements"
    tables = (("", "up to 3 A", 0.01), ("_fine", "up to 3 A, its finer mesh", 0.01), ("_saturated", "4 to 12 A", 0.04))
    for table, words, bound in tables:
        for worst in (False, True):
            which = "largest" if worst else "median"
            name = f"steel disc before a steel core, {words}: {which} difference of the force"
            ours = partial(cases.difference_from_peer, f"steel_xfemm{table}.csv", worst)
            yield Row(PEERS, name, source, "", None, ours, bound, cheap=False)


PUBLISHED = Path(__file__).with_name("published")

LIFTING_MAGNET = {
    0.25: (85.8619, 0.11954),
    0.5: (59.9662, 0.11004),
    1.0: (28.88, 0.088425),
    2.0: (11.1188, 0.064492),
    3.0: (6.5591, 0.052733),
    5.0: (3.5869, 0.039467),
}
"""Gap in mm -> pull in N and static inductance in H at 12 V over 10 ohm."""

MOVING_COIL = {-20.0: (-9.05337, 6.38e-3), -16.0: (-9.65616, 4.86e-3), -12.0: (-9.07503, 3.32e-3)}
"""Distance of the drawing in mm -> force in N at -3 A and inductance in H, with iron of a permeability of 1000."""

MOVING_COIL_ATTRACTED = 13.07415
"""Force in N at 3 A in the middle."""


@cache
def solved(name, distance_mm):
    """Columns of a drawing's sweep at a distance, as arrays."""
    actuator = read_actuator(PUBLISHED / f"{name}.toml")
    settings, distance = settings_for(actuator), 1e-3 * distance_mm
    problem = prepare(actuator, (distance,), layout_of(actuator, settings), settings)
    rows = problem.rows(distance, swept_currents(actuator.sweep))
    return {name: np.array(values) for name, values in rows.items()}


def lifting_magnet(gap_mm):
    """Pull in N and static inductance in H."""
    rows = solved("lifting-magnet", gap_mm)
    return float(rows["force_N"][0]), float(rows["flux_linkage_Wb"][0] / 1.2)


def moving_coil(distance_mm):
    """Force in N at -3 A and at 3 A, and inductance in H."""
    rows = solved("moving-coil", distance_mm)
    return float(rows["force_N"][0]), float(rows["force_N"][2]), float(rows["inductance_H"][1])


def moving_coil_of_height(height):
    """Force in N at -3 A in the middle of a coil of another height in m, which the source leaves open."""
    drawn = read_actuator(PUBLISHED / "moving-coil.toml")
    (coil,) = drawn.coils
    corners = tuple((r, height if z > 0.0 else 0.0) for r, z in coil.vertices_m)
    distance = -0.010 - 0.5 * height
    sweep = replace(drawn.sweep, distances_m=(distance,))
    other = replace(drawn, coils=(replace(coil, vertices_m=corners),), sweep=sweep, tolerance=None)
    sources = np.array([1.0, -3.0])
    return float(sources @ prepared(other, distance).solve(distance).force @ sources)


def _printed() -> Iterator[Row]:
    """Stationary results beside lumped networks; program, mesh and boundary are not stated.

    Modelica Standard Library, Magnetic.FluxTubes.Examples: a lifting magnet in SolenoidActuator.ComparisonQuasiStatic,
    a moving coil in MovingCoilActuator, ForceStrokeBehaviour and ForceCurrentBehaviour.
    """
    source = "Modelica, SolenoidActuator"
    for gap, (newton, henry) in LIFTING_MAGNET.items():
        name, ours = f"lifting magnet, gap {gap:g} mm, 1.2 A", partial(lifting_magnet, gap)
        cheap = gap == 0.25  # the most saturated
        yield Row(PRINTED, f"{name}: pull", source, "N", newton, _part(0, ours), 0.025, cheap=cheap)
        yield Row(PRINTED, f"{name}: flux linkage / i", source, "H", henry, _part(1, ours), 0.011, cheap=cheap)
    source = "Modelica, MovingCoilActuator"
    for distance, (newton, henry) in MOVING_COIL.items():
        name, ours = f"moving coil, x = {-16.0 - distance:g} mm", partial(moving_coil, distance)
        cheap = distance == min(MOVING_COIL)
        yield Row(PRINTED, f"{name}: force at -3 A", source, "N", newton, _part(0, ours), 8e-3, cheap=cheap)
        yield Row(PRINTED, f"{name}: inductance", source, "H", henry, _part(2, ours), 0.013, cheap=cheap)
    name, newton = "moving coil, x = 0 mm: force at 3 A", MOVING_COIL_ATTRACTED
    yield Row(PRINTED, name, source, "N", newton, _part(1, moving_coil, -16.0), 5e-3)
    repelled = MOVING_COIL[-16.0][0]
    name = "moving coil, x = 0 mm: even part of the force at 3 A, twice"
    yield Row(PRINTED, name, source, "N", repelled + newton, lambda: sum(moving_coil(-16.0)[:2]), 0.015)
    for height in (8e-3, 14e-3):
        name = f"moving coil of {1e3 * height:g} mm, in its middle: force at -3 A"
        yield Row(PRINTED, name, source, "N", repelled, partial(moving_coil_of_height, height), 0.015)


COLUMNS = "| case | reference is | unit | reference | femfit | error |\n|---|---|---|---:|---:|---:|"


def reference_of(row: Row) -> float | None:
    """What a line is compared with; None where the number is itself a difference."""
    return row.reference() if callable(row.reference) else row.reference


def cells_of(row: Row, ours: float) -> list[str]:
    """The cells of a line; the error is that of the value as printed."""
    reference = reference_of(row)
    if reference is None:
        return [row.case, row.source, row.unit, "", f"{100.0 * ours:.2f} %", ""]
    printed = _number(ours)
    error = f"{100.0 * (float(printed) / reference - 1.0):+.4f} %"
    return [row.case, row.source, row.unit, _number(reference), printed, error]


def _number(value: float) -> str:
    return f"{value:.{DIGITS - 1}e}" if abs(value) < 1e-3 else f"{value:.{DIGITS}g}"


def render() -> str:
    """The page's own text above its first table, and the tables with everything computed."""
    parts, section = [PAGE.read_text(encoding="utf-8").partition("\n## ")[0]], ""
    for row in rows():
        if row.section != section:
            section = row.section
            parts.append(f"\n## {section}\n\n{COLUMNS}")
        parts.append(f"| {' | '.join(cells_of(row, row.ours()))} |")
    return "\n".join(parts) + "\n"


if __name__ == "__main__":
    PAGE.write_text(render(), encoding="utf-8")
