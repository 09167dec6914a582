"""What may be wrong with a bench record of a coil's voltage: the watch of coil records, and the winding's R i.

A voltage that is the winding's own shows its resistance on the plateaus, where the flux stands still.
"""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.integrate.constants import GAIN_TOLERANCE, PLATEAU_FOLLOWS
from femfit.integrate.plateaus import PlateauFlux
from femfit.integrate.record_watch import RecordWatch
from femfit.tables.coil_block import CoilBlock


def watch_run(
    time: FloatArray, voltage: FloatArray, induced: FloatArray, current: FloatArray, found: PlateauFlux
) -> tuple[Finding, ...]:
    """Gaps, clock jumps, samples clipped between plateaus, and a coil wired the wrong way round.

    Parameters
    ----------
    time, voltage : array, shape (n,)
        Of a run, in s, and V as the converter read it.
    induced, current : array, shape (n,)
        The voltage without R i, V, and the current, A.
    """
    between = voltage.copy()
    for first, last in zip(found.first, found.last, strict=True):
        between[first:last] = 0.0
    watch = RecordWatch(1.0, float(np.median(np.diff(time))), "current_A")
    seen = watch.advance(watch.start(), CoilBlock(time, between))
    wired = watch.advance(watch.start(), CoilBlock(time, induced, current=current))
    return (*watch.findings(seen), *(finding for finding in watch.findings(wired) if finding.code == "sign"))


def resistance_finding(voltage: FloatArray, current: FloatArray, given: float | None) -> Finding | None:
    """Whether the voltages of the plateaus contradict the resistance that is taken off.

    Parameters
    ----------
    voltage, current : array, shape (p,)
        Means of all plateaus as measured, V and A.
    given : float or None
        Resistance in ohm; None for a separate sensing coil, which shows none.
    """
    i, u = current - current.mean(), voltage - voltage.mean()
    spread, common = float(i @ i), float(i @ u)
    if spread <= 0.0 or common**2 <= PLATEAU_FOLLOWS * spread * float(u @ u):
        return None
    shown = common / spread
    if given is None:
        text = f"The plateaus' voltage follows the current as {shown:.4g} ohm would make it."
        remedy = f"Is it the winding's own voltage? Then it needs --resistance-ohm {shown:.4g}."
        return Finding("resistance", "warning", text, remedy, size=shown)
    if abs(shown - given) <= GAIN_TOLERANCE * given:
        return None
    wrong = "the sign of the voltage or the current is wrong" if shown < 0.0 else "the winding is warm, or another"
    text = f"The plateaus show {shown:.4g} ohm where {given:.4g} ohm are taken off: {wrong}."
    return Finding("resistance", "warning", text, size=shown)
