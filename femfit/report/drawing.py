"""The parts of an actuator as all pictures show them, and its full section, drawn to scale with its dimensions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from femfit.core.numerics import FloatArray
from femfit.device.electrics import HallElement
from femfit.device.materials import BHCurve
from femfit.device.parts import Actuator, Coil, LinearMaterial, Material, NonlinearMaterial, Region, is_iron
from femfit.field.layout import part_corners
from femfit.report.style import INK, MUTED, Axes, Figure, new_figure, plain, significant, words

COLOURS = {
    "iron, fixed": "#8c96a1",
    "iron, moving": "#5b6f86",
    "magnet": "#b0477d",
    "winding": "#e0a341",
    "not magnetic": "#dfe3e7",
}
"""Distinct in lightness as well as in hue."""

HALL_COLOUR = "#009e73"


@dataclass(frozen=True, eq=False)
class DrawnPart:
    """A region or a winding as it stands at a distance."""

    shape: Region | Coil
    moves: bool
    corners: FloatArray  # Of the half section (r, z) in m, shape (n, 2)

    @property
    def kind(self) -> str:
        """Its key in :data:`COLOURS`."""
        if isinstance(self.shape, Coil):
            return "winding"
        if self.shape.material.remanence_T:
            return "magnet"
        if is_iron(self.shape.material):
            return "iron, moving" if self.moves else "iron, fixed"
        return "not magnetic"

    @property
    def label(self) -> str:
        """What a legend says of it."""
        if isinstance(self.shape, Coil):
            text = words("drawing", "moving_coil" if self.moves else "coil", turns=plain(self.shape.turns))
            wire = self.shape.wire_diameter_m
            return text if wire is None else f"{text}\n{words('drawing', 'wire', diameter=plain(MM * wire))}"
        return f"{words('kinds', self.kind)}: {self.shape.material.name}\n({material_words(self.shape)})"


def drawn_parts(actuator: Actuator, distance: float) -> list[DrawnPart]:
    """Every part with the moving ones at a distance in m: fixed ones, windings, moving ones."""
    shapes: list[tuple[Region | Coil, bool]] = [(region, False) for region in actuator.fixed]
    shapes += [(coil, coil.moves) for coil in actuator.coils]
    shapes += [(region, True) for region in actuator.moving.regions]
    return [DrawnPart(s, moves, np.add(part_corners(s), (0.0, moves * distance))) for s, moves in shapes]


def full_section(half: FloatArray) -> tuple[FloatArray, ...]:
    """Corners (x, z) of a part in the full section: one outline on the axis, a left and a right one of a ring."""
    both = shapely.union_all([shapely.Polygon(half), shapely.Polygon(half * np.array([-1.0, 1.0]))])
    pieces = sorted(getattr(both, "geoms", [both]), key=lambda piece: float(piece.centroid.x))
    return tuple(np.asarray(piece.exterior.coords)[:-1] for piece in pieces)


def corners_of(parts: Iterable[DrawnPart]) -> FloatArray:
    """Corners (r, z) of parts in m, shape (n, 2)."""
    return np.concatenate([drawn.corners for drawn in parts])


def mirrored(radius: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A quantity that is even in r, shape (m, n), on the full section."""
    return np.concatenate([-radius[:0:-1], radius]), np.concatenate([values[:, :0:-1], values], axis=1)


KNEE_STEP, KNEE_FIELD = 1.1, 1.5
"""Knee of a B-H curve (conventional): 10 % more flux density take 50 % more field, as IEC 61869-2 defines a knee."""

USUAL_KNEES = "soft steel about 1.4 T, power ferrite about 0.25 T"
"""For iron that is drawn without a curve: knees of the library's own curves by the rule above."""


def knee_T(material: Material) -> float | None:  # noqa: N802 - the unit
    """Flux density from which 10 % more takes 50 % more field; None for a material without a B-H curve."""
    if isinstance(material, LinearMaterial):
        return None
    curve = BHCurve(material.flux_density_T, material.field_A_per_m)
    b = np.linspace(0.05, material.flux_density_T[-1], 2000)
    field = curve.field(b)
    beyond = (b >= b[np.argmax(b / field)]) & (curve.field(KNEE_STEP * b) >= KNEE_FIELD * field)
    return float(b[np.argmax(beyond)]) if beyond.any() else float(b[-1])


@dataclass(frozen=True)
class IronLoad:
    """Flux density in one iron part beside the knee of its material; None for a material without a B-H curve."""

    region: str
    material: str
    flux_density_T: float
    knee_T: float | None

    @property
    def margin(self) -> float | None:
        """How far the knee is above the flux density, as a part of the latter; negative beyond the knee."""
        if self.knee_T is None:
            return None
        return self.knee_T / self.flux_density_T - 1.0 if self.flux_density_T else np.inf


def iron_loads(actuator: Actuator, flux_density_T: Mapping[str, float]) -> tuple[IronLoad, ...]:
    """Each iron part beside its largest flux density: the part nearest to its knee first, then the most loaded."""
    loads = [
        IronLoad(region.name, region.material.name, flux_density_T[region.name], knee_T(region.material))
        for region in actuator.regions
        if is_iron(region.material) and region.name in flux_density_T
    ]
    return tuple(sorted(loads, key=lambda load: (load.knee_T is None, -load.flux_density_T / (load.knee_T or 1.0))))


MM = 1e3

Place = tuple[float, float]

_BOX = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}


def actuator_figure(actuator: Actuator, distance: float, title: str = "") -> Figure:
    """Draw an actuator in mm, with the moving part at a distance in m below the fixed one."""
    parts = drawn_parts(actuator, distance)
    (_, low), (outer, high) = MM * corners_of(parts).min(axis=0), MM * corners_of(parts).max(axis=0)
    figure = new_figure(float(np.clip(1.2 + 1.8 * (high - low) / outer, 3.4, 6.4)))
    axes = figure.subplots()
    _draw_parts(axes, parts, actuator.hall)
    over = 0.06 * (high - low)
    axes.plot([0.0, 0.0], [low - over, high + over], color=MUTED, linewidth=0.7, dashes=(9, 3, 2, 3))
    _dimensions(axes, parts, distance)
    # Limits that give way, not the box: the layout leaves room for labels beside the box that it knows
    axes.set(xlabel=words("drawing", "x"), ylabel=words("drawing", "z"), aspect="equal", adjustable="datalim")
    axes.set_title(title, loc="left", fontweight="normal")
    axes.margins(x=0.2)  # room for the dimensions' labels
    axes.invert_yaxis()  # z points down in every picture, as the moving part hangs below
    axes.grid(visible=False)
    legend = axes.get_legend_handles_labels()
    figure.legend(*legend, loc="outside right upper", handlelength=1.2, labelspacing=0.8)
    return figure


def _draw_parts(axes: Axes, parts: Sequence[DrawnPart], hall: HallElement | None) -> None:
    """Draw the parts' full section with a legend, in mm."""
    named: set[str] = set()
    for drawn in parts:
        for piece in full_section(drawn.corners):
            text = "" if drawn.label in named else drawn.label
            axes.fill(*(MM * piece.T), facecolor=COLOURS[drawn.kind], edgecolor=INK, linewidth=0.8, label=text)
            named.add(drawn.label)
    for drawn in parts:
        _magnetisation(axes, drawn)
    if hall is not None:
        look: dict[str, Any] = {"color": HALL_COLOUR, "markeredgecolor": INK, "markersize": 6, "zorder": 5}
        axes.plot(MM * hall.radius_m, MM * hall.height_m, "D", label=words("drawing", "hall"), **look)


def draw_outlines(axes: Axes, parts: Iterable[DrawnPart], *, edge: str, opacity: float = 0.0) -> None:
    """Draw the parts' outlines in the full section, as over a field, in mm."""
    for drawn in parts:
        for piece in full_section(drawn.corners):
            if opacity:
                axes.fill(*(MM * piece.T), facecolor=COLOURS[drawn.kind], edgecolor="none", alpha=opacity)
            axes.fill(*(MM * piece.T), facecolor="none", edgecolor=edge, linewidth=0.8)


def material_words(region: Region) -> str:
    """What a region's material does, in a few words: remanence, permeability or the knee of its curve."""
    material = region.material
    if isinstance(material, NonlinearMaterial):
        return words("drawing", "curve", knee=significant(knee_T(material) or 0.0, 2))
    permeability = plain(material.relative_permeability)
    if material.remanence_T:
        return words("drawing", "magnet", remanence=plain(abs(material.remanence_T)), permeability=permeability)
    return words("drawing", "linear", permeability=permeability)


def _magnetisation(axes: Axes, drawn: DrawnPart) -> None:
    material = drawn.shape.material if isinstance(drawn.shape, Region) else None
    if not isinstance(material, LinearMaterial) or not material.remanence_T:
        return
    radial, axial = np.sign(material.remanence_T) * np.asarray(material.direction)
    for outline in full_section(drawn.corners):
        low, high = outline.min(axis=0), outline.max(axis=0)
        middle, size = 0.5 * (low + high), 0.7 * (high - low)
        # On the left side of the section what points outwards points to the left; across the axis nothing is one way
        side = 0.0 if low[0] < 0.0 < high[0] else np.sign(middle[0])
        along = np.array([side * radial, axial])
        reach = 0.5 * np.min(size[along != 0.0] / np.abs(along[along != 0.0]), initial=np.inf)
        if not np.isfinite(reach):
            continue
        axes.annotate(
            "",
            xy=MM * (middle + reach * along),
            xytext=MM * (middle - reach * along),
            arrowprops={"arrowstyle": "-|>", "color": "white", "linewidth": 1.8, "mutation_scale": 13},
        )


def _dimensions(axes: Axes, parts: Sequence[DrawnPart], distance: float) -> None:
    """Diameters above and below, lengths of the fixed part on the left, of moving part and distance on the right."""
    still, moving = (MM * corners_of(drawn for drawn in parts if drawn.moves is moves) for moves in (False, True))
    (r_in, z_low), (r_out, z_high) = still.min(axis=0), still.max(axis=0)
    m_low, m_high, m_out = moving[:, 1].min(), moving[:, 1].max(), moving[:, 0].max()
    low, high, wide = min(z_low, m_low), max(z_high, m_high), max(r_out, m_out)
    step = 0.085 * max(2.0 * wide, high - low)
    diameters = [(r_out, low - (2.0 if r_in > 0 else 1.2) * step, z_low), (m_out, high + 1.2 * step, m_high)]
    diameters += [(r_in, low - 0.8 * step, z_low)] if r_in > 0 else []
    for r, z, face in diameters:
        _dimension(axes, ((-r, z), (r, z)), ((-r, face), (r, face)), (r, z), f"Ø {plain(2 * r, 4)}")
    for x, (begin, end), face, name in (
        (-wide - step, (z_low, z_high), -r_out, ""),
        (wide + step, (m_low, m_high), m_out, ""),
        (wide + 3.0 * step, (0.0, MM * distance), min(m_out, r_out), "d = "),
    ):
        middle, text = (x, 0.5 * (begin + end)), f"{name}{plain(end - begin, 4)}"
        _dimension(axes, ((x, begin), (x, end)), ((face, begin), (face, end)), middle, text, bold=bool(name))


def _dimension(
    axes: Axes, ends: tuple[Place, Place], feet: tuple[Place, Place], place: Place, text: str, *, bold: bool = False
) -> None:
    """Draw a length with extension lines from its feet on the part; its label stands outside, beside a place of it."""
    for foot, end in zip(feet, ends, strict=True):
        axes.plot([foot[0], end[0]], [foot[1], end[1]], color=MUTED, linewidth=0.6)
    arrow = {"arrowstyle": "<|-|>", "color": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
    axes.annotate("", xy=ends[1], xytext=ends[0], arrowprops=arrow)
    side = float(np.sign(place[0]))
    axes.annotate(
        text, place, xytext=(5 * side, 0), textcoords="offset points", ha="left" if side > 0 else "right", va="center",
        fontsize=8.5 if bold else 8, fontweight="bold" if bold else "normal", bbox=_BOX,
    )  # fmt: skip
