"""The quantities that a sweep table can hold and their names in several languages.

English, German, Dutch, French, Italian, Spanish, Portuguese, Slovene and the Nordic languages; written without
accents, blanks and punctuation. Names of one letter count only as a whole header or as its first word.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """One column of the sweep table.

    Parameters
    ----------
    column : str
        Its name in :data:`femfit.tables.sweep_table.COLUMNS`.
    si_unit : str
        A key of :data:`femfit.tables.units.UNITS`.
    option : str
        Start of its command line options, as in ``--force-column`` and ``--force-unit``.
    """

    column: str
    si_unit: str
    names: tuple[str, ...]
    option: str


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split())


QUANTITIES: dict[str, Quantity] = {
    "current": Quantity(
        "current_A",
        "A",
        _names(
            "i current currents curr amp amps ampere amperes coilcurrent icoil strom stromstarke spulenstrom stroom "
            "stroomsterkte spoelstroom courant intensite intensitecourant corrente intensita corriente intensidad tok "
            "tokovi"
        ),
        "current",
    ),
    "distance": Quantity(
        "distance_m",
        "m",
        _names(
            "d x z s y gap airgap distance distances dist position positions pos displacement disp stroke travel "
            "separation clearance zpos xpos abstand luftspalt spalt weg hub verschiebung auslenkung afstand positie "
            "luchtspleet verplaatsing slag entrefer deplacement course ecart distanza posizione traferro spostamento "
            "corsa distancia posicion entrehierro desplazamiento carrera posicao entreferro deslocamento "
            "razdalja polozaj zracnareza reza pomik odmik hod avstand lage "
            "step steps schritt schritte stap stappen pas passo passi paso pasos korak koraki"
        ),
        "distance",
    ),
    "force": Quantity(
        "force_N",
        "N",
        _names(
            "f fz fx fy fem fmag force forces pull pullforce thrust attraction kraft krafte magnetkraft zugkraft "
            "kracht trekkracht forza fuerza forca sila"
        ),
        "force",
    ),
    "flux_linkage": Quantity(
        "flux_linkage_Wb",
        "Wb",
        _names(
            "psi lambda λ ψ phi fluxlinkage linkage linkedflux flux verketteterfluss flussverkettung spulenfluss fluss "
            "gekoppeldeflux fluxkoppeling spoelflux fluxembrasse fluxtotalise fluxtotal fluxbobine flussoconcatenato "
            "flusso flujoconcatenado flujoenlazado flujo fluxoconcatenado fluxo magnetnisklep sklep fluks flode"
        ),
        "flux-linkage",
    ),
    "inductance": Quantity(
        "inductance_H",
        "H",
        _names(
            "l inductance selfinductance induktivitat induktivitaet inductiviteit zelfinductie inductantie induttanza "
            "inductancia indutancia induktivnost induktans"
        ),
        "inductance",
    ),
    "hall": Quantity(
        "hall_T",
        "T",
        _names(
            "b bz hall hallfield bhall fluxdensity magneticfluxdensity magneticfield flussdichte hallfeld "
            "fluxdichtheid inductionmagnetique densitedeflux densitadiflusso induzione densidaddeflujo "
            "induccion gostotapretoka"
        ),
        "hall",
    ),
    "coenergy": Quantity(
        "coenergy_J",
        "J",
        _names("wc wco coenergy koenergie coenergie coenergia koenergija koenergi magneticcoenergy"),
        "coenergy",
    ),
    "force_error": Quantity("force_error_N", "N", _names("forceerror"), "force-error"),
}
"""Key (as in the import options) to quantity."""

REQUIRED = ("current", "distance", "force")

STEP_NAMES = _names("step steps schritt schritte stap stappen pas passo passi paso pasos korak koraki")
"""Names of a distance that counts steps: it needs the step's size."""

FOREIGN_WORDS = frozenset(
    _names(
        "resistance widerstand weerstand resistencia resistenza upor voltage spannung spanning tension tensione "
        "napetost power leistung puissance potenza time zeit temps tempo cas loss losses nodes elements error density "
        "energy velocity speed temperature torque moment"
    )
)
"""Words that make a header something else: *current density*, *force error*, *coil resistance*."""
