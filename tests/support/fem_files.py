"""Small FEMM files written by hand, for tests of the importer."""

from dataclasses import dataclass, field
from itertools import pairwise

AIR, STEEL, MAGNET, COPPER = "Air", "Pure Steel", "N40", "Copper"
UNIT_MM = {
    "inches": 25.4,
    "millimeters": 1.0,
    "centimeters": 10.0,
    "mils": 0.0254,
    "microns": 1e-3,
    "meters": 1e3,
}


@dataclass
class FemDrawing:
    """A drawing in mm, written in any unit."""

    unit: str = "millimeters"
    header: dict = field(default_factory=dict)
    materials: dict = field(
        default_factory=lambda: {
            AIR: {},
            STEEL: {"Mu_x": 500, "Mu_y": 500},
            MAGNET: {"Mu_x": 1.05, "Mu_y": 1.05, "H_c": 970000},
            COPPER: {"Sigma": 58},
        }
    )
    boundaries: dict = field(default_factory=lambda: {"A=0": {"BdryType": 0}})
    circuits: dict = field(default_factory=lambda: {"coil": {"TotalAmps_re": 2, "CircuitType": 1}})
    point_properties: dict = field(default_factory=dict)
    points: list = field(default_factory=list)
    segments: list = field(default_factory=list)
    arcs: list = field(default_factory=list)
    labels: list = field(default_factory=list)
    holes: list = field(default_factory=list)

    def point(self, r, z, prop=0):
        if (r, z, prop) not in self.points:
            self.points.append((r, z, prop))
        return self.points.index((r, z, prop))

    def line(self, *corners, boundary=0):
        for a, b in pairwise(corners):
            self.segments.append((self.point(*a), self.point(*b), boundary))

    def arc(self, a, b, degrees, boundary=0):
        self.arcs.append((self.point(*a), self.point(*b), degrees, boundary))

    def box(self, r0, r1, z0, z1):
        self.line((r0, z0), (r1, z0), (r1, z1), (r0, z1), (r0, z0))

    def label(self, r, z, material, circuit=0, magdir=0, group=0, turns=1, flags=0, formula=""):
        self.labels.append([r, z, material, circuit, magdir, group, turns, flags, formula])

    def relabel(self, material, **changes):
        """Change the labels of a material."""
        keys = ("r", "z", "name", "circuit", "magdir", "group", "turns", "flags", "formula")
        for label in self.labels:
            if label[2] == material:
                for key, value in changes.items():
                    label[keys.index(key)] = value

    def text(self):
        scale = 1.0 / UNIT_MM[self.unit]
        header = {
            "Format": 4.0,
            "Frequency": 0,
            "Precision": 1e-8,
            "MinAngle": 30,
            "Depth": 1,
            "LengthUnits": self.unit,
            "ProblemType": "axisymmetric",
            "Coordinates": "cartesian",
            **self.header,
        }
        lines = [f"[{key}] = {value}" for key, value in header.items()]
        lines += _properties("PointProps", "Point", "PointName", self.point_properties)
        lines += _properties("BdryProps", "Bdry", "BdryName", self.boundaries)
        lines += _properties("BlockProps", "Block", "BlockName", self.materials)
        lines += _properties("CircuitProps", "Circuit", "CircuitName", self.circuits)
        lines.append(f"[NumPoints] = {len(self.points)}")
        lines += [f"{r * scale!r}\t{z * scale!r}\t{prop}\t0" for r, z, prop in self.points]
        lines.append(f"[NumSegments] = {len(self.segments)}")
        lines += [f"{a}\t{b}\t-1\t{boundary}\t0\t0" for a, b, boundary in self.segments]
        lines.append(f"[NumArcSegments] = {len(self.arcs)}")
        lines += [f"{a}\t{b}\t{degrees}\t5\t{boundary}\t0\t0" for a, b, degrees, boundary in self.arcs]
        lines.append(f"[NumHoles] = {len(self.holes)}")
        lines += [f"{r * scale!r}\t{z * scale!r}\t0" for r, z in self.holes]
        lines.append(f"[NumBlockLabels] = {len(self.labels)}")
        names = list(self.materials)
        for r, z, material, circuit, magdir, group, turns, flags, formula in self.labels:
            number = names.index(material) + 1 if material in names else material
            end = f'\t"{formula}"' if formula else ""
            lines.append(
                f"{r * scale!r}\t{z * scale!r}\t{number}\t-1\t{circuit}\t{magdir}\t{group}\t{turns}\t{flags}{end}"
            )
        return "\n".join(lines) + "\n"

    def content(self):
        return self.text().encode()


def _properties(section, kind, name_key, items):
    lines = [f"[{section}] = {len(items)}"]
    for name, values in items.items():
        lines += [f"  <Begin{kind}>", f'    <{name_key}> = "{name}"']
        lines += [f"    <{key}> = {value}" for key, value in values.items() if key != "curve"]
        curve = values.get("curve", ())
        if kind == "Block":
            lines += [f"    <BHPoints> = {len(curve)}", *(f"      {b}\t{h}" for b, h in curve)]
        lines.append(f"  <End{kind}>")
    return lines


def suspension(*, below=False, distance=4.0, face=0.0, radius=80.0, boundary=1, **options):
    """A steel core in a coil, a magnet before its face: everything in mm, air out to a half circle."""
    drawing = FemDrawing(**options)
    up = -1.0 if below else 1.0

    def box(r0, r1, low, high):
        drawing.box(r0, r1, *sorted((face + up * low, face + up * high)))

    def label(r, z, *arguments, **values):
        drawing.label(r, face + up * z, *arguments, **values)

    box(0, 4, -12, 0)
    box(5, 9, -11, -1)
    box(0, 3, distance, distance + 5)
    drawing.line((0, face - radius), (0, face + radius))
    drawing.arc((0, face - radius), (0, face + radius), 180, boundary)
    label(2, -6, STEEL, group=1)
    label(7, -6, COPPER, circuit=1, turns=200, group=2)
    label(1.5, distance + 2, MAGNET, magdir=90, group=3)
    label(30, 30, AIR)
    return drawing
