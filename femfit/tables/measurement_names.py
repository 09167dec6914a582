"""What benches call the columns of a measurement, in English and German.

Written without accents, blanks and punctuation. Names of one letter count only beside a unit of the right kind.
"""

MEASUREMENT_NAMES: dict[str, tuple[str, ...]] = {
    name: tuple(text.split())
    for name, text in {
        "run": "runno runnumber runnr lauf laufnr durchlauf messlauf messreihe",
        "mount": "mounting mountno remount aufspannung aufspannungnr einbau",
        "order": "seq sequence reihenfolge lfdnr",
        "current_A": "i icoil coilcurrent strom stromstarke spulenstrom",
        "distance_m": "d x z gap airgap position displacement abstand luftspalt spalt weg",
        "branch": "direction richtung ast zweig",
        "coil_temperature_C": "coiltemp tcoil windingtemperature spulentemperatur tspule wicklungstemperatur",
        "magnet_temperature_C": "magnettemp tmagnet magnettemperatur",
        "force_N": "f fz fmag kraft magnetkraft zugkraft haltekraft",
        "flux_linkage_Wb": "psi lambda fluxlinkage linkedflux flussverkettung verketteterfluss",
        "hall_V": "vhall uhall hallvoltage halloutput hallsensor hallspannung",
        "voltage_V": "u v ucoil vcoil coilvoltage spannung spulenspannung",
        "time_s": "t zeit timestamp",
    }.items()
}
"""The contract's name to others for it."""
