"""What a real actuator may have that its drawing does not: the same drawing with one thing changed.

Each function returns a drawing of which the field is solved anew; nothing here is an approximation of a field.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from femfit.core.arrays import FloatArray
from femfit.core.constants import MU_0
from femfit.core.errors import MissingPartError
from femfit.device.parts import AIR, Actuator, LinearMaterial, Material, NonlinearMaterial, Region

_IRON_PERMEABILITY = 600.0
"""Tells iron from ferrite."""


def is_magnet(region: Region) -> bool:
    """Whether a region has a remanence."""
    return region.material.remanence_T != 0.0


def is_soft(region: Region) -> bool:
    """Whether a region is iron or ferrite."""
    return not is_magnet(region) and region.material.relative_permeability > 10.0


def is_linear_iron(region: Region) -> bool:
    """Whether a region is iron or ferrite that is drawn without a B-H curve."""
    return is_soft(region) and isinstance(region.material, LinearMaterial)


def has_magnet(actuator: Actuator) -> bool:
    """Whether any part is a permanent magnet."""
    return any(map(is_magnet, (*actuator.fixed, *actuator.moving.regions)))


def moves_magnet(actuator: Actuator) -> bool:
    """Whether the moving part is magnets and nothing soft."""
    return any(map(is_magnet, actuator.moving.regions)) and not any(map(is_soft, actuator.moving.regions))


def scaled_magnets(actuator: Actuator, change: float) -> Actuator:
    """Every magnet with 1 + change times its remanence."""
    return _with_materials(actuator, lambda region: _scaled(region, 1.0 + change), is_magnet)


def scaled_turns(actuator: Actuator, change: float) -> Actuator:
    """The only coil with 1 + change times its turns."""
    return replace(actuator, coils=(replace(actuator.coil, turns=(1.0 + change) * actuator.coil.turns),))


def without_magnets(actuator: Actuator) -> Actuator:
    """Every magnet as if never magnetised."""
    return scaled_magnets(actuator, -1.0)


def weak_layer(actuator: Actuator, change: float) -> Actuator:
    """The third of the first magnet next to the gap with 1 + change times its remanence: partly demagnetised."""
    in_moving = any(map(is_magnet, actuator.moving.regions))
    regions = actuator.moving.regions if in_moving else actuator.fixed
    magnet = next(filter(is_magnet, regions))
    r, z = np.array(magnet.vertices_m).T
    near, far = (z.min(), z.max()) if in_moving else (z.max(), z.min())
    cut = near + (far - near) / 3.0
    weak = _rectangle(f"{magnet.name}_weak", (r.min(), r.max()), (near, cut), _scaled(magnet, 1.0 + change))
    rest = _rectangle(magnet.name, (r.min(), r.max()), (cut, far), magnet.material)
    changed = tuple(part for region in regions for part in ((weak, rest) if region is magnet else (region,)))
    if in_moving:
        return replace(actuator, moving=replace(actuator.moving, regions=changed))
    return replace(actuator, fixed=changed)


def remembering_core(actuator: Actuator, remanence: float) -> Actuator:
    """The fixed soft parts with the remanence that the winding's flux leaves in them.

    Along the axis within the winding and against it outside of it, where the flux returns; parts above and below the
    winding lead it outwards and are left as they are.

    Parameters
    ----------
    remanence : float
        B_r in T, positive where it adds to the flux of a positive current.
    """
    winding_r, winding_z = np.array(actuator.coil.vertices_m).T

    def way(region: Region) -> float:
        r, z = np.array(region.vertices_m).T
        if z.max() <= winding_z.min() or z.min() >= winding_z.max():
            return 0.0
        return -1.0 if r.min() >= winding_r.max() else 1.0

    def magnetised(region: Region) -> Region:
        own = LinearMaterial("core", region.material.relative_permeability, way(region) * remanence)
        return replace(region, material=own) if is_soft(region) else region

    return replace(actuator, fixed=tuple(map(magnetised, actuator.fixed)))


def remanent_core(actuator: Actuator, remanence: float) -> Actuator:
    """The fixed soft parts with a remanence along the axis: what an outer field is to them.

    Parameters
    ----------
    remanence : float
        B_r in T.
    """

    def magnetised(region: Region) -> Material:
        return LinearMaterial("core", region.material.relative_permeability, remanence)

    return replace(
        actuator,
        fixed=tuple(replace(part, material=magnetised(part)) if is_soft(part) else part for part in actuator.fixed),
    )


def saturable_core(actuator: Actuator, polarisation: float, sharpness: float) -> Actuator:
    """Every soft part that is drawn without a curve with one that starts at its permeability and saturates.

    B = mu_0 H + chi mu_0 H / (1 + (chi mu_0 H / J_s)^n)^(1/n): n = 1 is the law of Froehlich and Kennelly, larger n
    have a sharper knee.

    Parameters
    ----------
    polarisation : float
        J_s of ferrite in T; iron has four times as much.

    References
    ----------
    R. M. Bozorth, Ferromagnetism (Van Nostrand, 1951), chapter 11: the curve for n = 1.
    """
    return with_curve(actuator, lambda x: x / (1.0 + x**sharpness) ** (1.0 / sharpness), polarisation)


def with_curve(actuator: Actuator, law: Callable[[FloatArray], FloatArray], polarisation: float) -> Actuator:
    """Every soft part that is drawn without a curve with J = J_s law(chi mu_0 H / J_s); law(x) rises as x to 1."""

    def curve(region: Region) -> Material:
        held = polarisation * (4.0 if region.material.relative_permeability > _IRON_PERMEABILITY else 1.0)
        x = np.concatenate([[0.0], np.geomspace(0.02, 60.0, 48)])
        h = x * held / (MU_0 * (region.material.relative_permeability - 1.0))
        b = MU_0 * h + held * law(x)
        return NonlinearMaterial("saturable", tuple(b.tolist()), tuple(h.tolist()))

    return _with_materials(actuator, curve, is_linear_iron)


def with_iron_ring(actuator: Actuator) -> Actuator:
    """The body in a holder with an iron ring that the drawing does not show, without any magnet."""
    r, z = np.concatenate([np.array(region.vertices_m) for region in actuator.moving.regions]).T
    height = (z.min() + 0.5 * np.ptp(z), z.min() + 0.8 * np.ptp(z))
    body = shapely.union_all([shapely.Polygon(region.vertices_m) for region in actuator.moving.regions])
    around = shapely.box(0.0, height[0], 1.4 * r.max(), height[1]).difference(body)
    spacer = Region("spacer", tuple(orient(around).exterior.coords[:-1]), AIR)
    ring = _rectangle("ring", (1.4 * r.max(), 2.2 * r.max()), height, LinearMaterial("iron", 1000.0))
    bare = without_magnets(actuator)
    return replace(bare, moving=replace(bare.moving, regions=(*bare.moving.regions, spacer, ring)))


def plunger_bore(actuator: Actuator) -> tuple[Region, float, float]:
    """The fixed soft region that a plunger slides through, with its bore's and the plunger's radius."""
    plunger = max(
        (max(r for r, _ in region.vertices_m) for region in actuator.moving.regions if is_soft(region)), default=0
    )
    for region in filter(is_soft, actuator.fixed):
        wider = [r for r, z in region.vertices_m if z > 0.0 and plunger < r < 1.3 * plunger]
        if len(wider) > 1:
            return region, min(wider), plunger
    raise MissingPartError(f"{actuator.name} must have a plunger that slides through a bore; none was found.")


def eccentric_bore(actuator: Actuator, offset: float) -> Actuator:
    """A plunger that lies off the axis of its bore by ``offset``, as the coaxial gap of the same permeance.

    Between two cylinders of radii a < b whose axes are c apart the permeance is 2 pi / arccosh((a^2 + b^2 - c^2) /
    (2 a b)) per length, which is ln(b / a) in place of the arccosh where c = 0.

    References
    ----------
    W. R. Smythe, Static and Dynamic Electricity (McGraw-Hill, 1968), section 4.14.
    """
    region, bore, plunger = plunger_bore(actuator)
    cosine = (plunger**2 + bore**2 - offset**2) / (2.0 * plunger * bore)
    return with_bore(actuator, plunger * float(np.exp(np.arccosh(cosine))), region)


def with_bore(actuator: Actuator, radius: float, region: Region | None = None) -> Actuator:
    """A plunger's bore with another radius.

    Parameters
    ----------
    region : Region or None
        With the bore; found where None.
    """
    found, bore, _ = plunger_bore(actuator)
    region = region or found
    vertices = tuple((radius if abs(r - bore) < 1e-9 else r, z) for r, z in region.vertices_m)
    fixed = tuple(replace(part, vertices_m=vertices) if part is region else part for part in actuator.fixed)
    return replace(actuator, fixed=fixed)


def _scaled(region: Region, factor: float) -> LinearMaterial:
    if not isinstance(region.material, LinearMaterial):
        raise MissingPartError(f"{region.name} must be a magnet to be scaled; its material is {region.material.name}.")
    return replace(region.material, remanence_T=factor * region.material.remanence_T)


def _rectangle(name: str, r: tuple[float, float], z: tuple[float, float], material: Material) -> Region:
    low, high = sorted(z)
    return Region(name, ((r[0], low), (r[1], low), (r[1], high), (r[0], high)), material)


def _with_materials(
    actuator: Actuator, change: Callable[[Region], Material], where: Callable[[Region], bool]
) -> Actuator:
    def changed(regions: tuple[Region, ...]) -> tuple[Region, ...]:
        return tuple(replace(region, material=change(region)) if where(region) else region for region in regions)

    moving = replace(actuator.moving, regions=changed(actuator.moving.regions))
    return replace(actuator, fixed=changed(actuator.fixed), moving=moving)
