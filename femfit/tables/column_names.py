"""What tables call their columns, in English and German.

Written without accents, blanks and punctuation. A name of one letter, and one behind ``?``, counts in a measurement
only beside a unit of the right kind: a column ``mass`` or ``scale`` is a force where it is in grams or newtons.
"""

_ROWS = """
run                   en run runno runnumber series
run                   de runnr lauf laufnr durchlauf messlauf messreihe serie
mount                 en mount mounting mountno remount
mount                 de aufspannung aufspannungnr einbau
order                 en order seq sequence
order                 de reihenfolge lfdnr
branch                en branch direction
branch                de richtung ast zweig
time_s                en t time timestamp clock datetime
time_s                de zeit uhrzeit zeitstempel
r_m                   en radius prober
z_m                   en height probez
field_T               en b bz field fluxdensity
field_T               de feld flussdichte
current_A             en i current currents curr amp amps ampere amperes coilcurrent icoil
current_A             en idc ibias biascurrent dcbias dcbiascurrent dccurrent ?bias
current_A             de strom stromstarke spulenstrom gleichstrom vorstrom biasstrom
distance_m            en d x z s y gap airgap distance distances dist position positions pos displacement disp stroke
distance_m            en travel separation clearance zpos xpos
distance_m            de abstand luftspalt spalt weg hub verschiebung auslenkung lage
force_N               en f fz fx fy fem fmag force forces pull pullforce thrust attraction ?mass ?scale ?balance ?weight
force_N               en ?loadcell ?load
force_N               de kraft krafte magnetkraft zugkraft haltekraft ?masse ?waage ?gewicht ?kraftmessdose
flux_linkage_Wb       en psi lambda λ ψ phi fluxlinkage linkage linkedflux flux
flux_linkage_Wb       de verketteterfluss flussverkettung spulenfluss fluss
frequency_Hz          en f freq frequency frequencies testfrequency testfreq omega hz
frequency_Hz          de frequenz frequenzen messfrequenz pruffrequenz
impedance_ohm         en z zabs absz zmag magz impedance impedancemagnitude ?magnitude ?mag
impedance_ohm         de impedanz scheinwiderstand betragz zbetrag ?betrag
phase_deg             en phase phaseangle theta thetaz phasez zphase argz zarg thz θ θz phi ?angle ?arg
phase_deg             de phasenwinkel phasenlage ?winkel
reactance_ohm         en x xs reactance imz zim imagz zimag
reactance_ohm         de reaktanz blindwiderstand imaginarteilz
parallel_resistance_ohm en rp rpar parallelresistance
parallel_resistance_ohm de parallelwiderstand
parallel_inductance_H en lp lpar parallelinductance
parallel_inductance_H de parallelinduktivitat
Q                     en q qualityfactor quality
Q                     de gute gutefaktor
D                     en d df dissipation dissipationfactor lossfactor tandelta
D                     de verlustfaktor
inductance_H          en l inductance selfinductance ls lser seriesinductance
inductance_H          de induktivitat induktivitaet reiheninduktivitat serieninduktivitat
resistance_ohm        en r resistance dcresistance coilresistance windingresistance rdc
resistance_ohm        en rs rser seriesresistance esr rac acresistance rez zre realz zreal
resistance_ohm        de widerstand wicklungswiderstand spulenwiderstand
resistance_ohm        de wirkwiderstand reihenwiderstand serienwiderstand realteilz
hall_T                en b bz hall hallfield bhall fluxdensity magneticfluxdensity magneticfield
hall_T                de flussdichte hallfeld
hall_V                en hall vhall uhall hallvoltage halloutput hallsensor
hall_V                de hallspannung
voltage_V             en u v voltage ucoil vcoil coilvoltage
voltage_V             de spannung spulenspannung
position_V            en positionvoltage positionsensor
position_V            de wegsensor
pickup_V              en pickupvoltage pickupcoil searchcoil
acceleration_m_s2     en acc accel acceleration accelerometer
acceleration_m_s2     de beschleunigung
coil_voltage_V        en coilvoltage
coil_temperature_C    en coiltemperature coiltemp tcoil windingtemperature
coil_temperature_C    de spulentemperatur tspule wicklungstemperatur
magnet_temperature_C  en magnettemperature magnettemp tmagnet
magnet_temperature_C  de magnettemperatur
coenergy_J            en wc wco coenergy magneticcoenergy
coenergy_J            de koenergie
force_error_N         en forceerror
"""


def _rows() -> list[tuple[str, list[str]]]:
    return [(fields[0], fields[2:]) for fields in map(str.split, _ROWS.strip().splitlines())]


COLUMN_NAMES: dict[str, tuple[str, ...]] = {
    column: tuple(name.lstrip("?") for other, names in _rows() for name in names if other == column)
    for column in dict.fromkeys(column for column, _ in _rows())
}
"""Column to its names."""

NEEDS_UNIT = frozenset(name[1:] for _, names in _rows() for name in names if name.startswith("?"))
"""Names that mean the column only beside a unit of its kind."""

_OTHER_QUANTITIES = """
resistance widerstand voltage spannung tension power leistung time zeit tempo loss losses nodes elements error density
energy velocity speed temperature torque moment
"""

STEP_NAMES = frozenset(("step", "steps", "schritt", "schritte"))
"""Names of a distance that counts steps: it needs the step's size."""

OTHER_QUANTITIES = frozenset(_OTHER_QUANTITIES.split())
"""Words that make a header something else: *current density*, *force error*, *coil resistance*."""
