"""The ``femfit`` command: names and one-line helps; each command's file is imported when it runs."""

import os
import sys

from cyclopts import App, CycloptsError

from femfit import __version__
from femfit.core.errors import FemfitError

COMMANDS: tuple[tuple[str, str, str], ...] = (
    # name, target, one line of help
    ("run", "femfit.cli.run:run", "Sweep, fit, export, close the loop and report, in turn."),
    ("sweep", "femfit.cli.sweep:sweep", "Solve the field over an actuator's currents and distances."),
    ("view", "femfit.cli.view:view", "Draw geometry, mesh, flux lines, |B| and permeability; write a .vtu file."),
    ("import", "femfit.cli.import_table:import_table", "Bring in a table of FEMM or another program as a sweep table."),
    ("import-fem", "femfit.cli.import_fem:import_fem", "Read a FEMM model (.fem) as an actuator file."),
    ("fit", "femfit.cli.fit:fit", "Fit a force law or a co-energy to a sweep table, and write the model file."),
    ("export", "femfit.cli.export:export", "Export a model: filters and simulator that need numpy alone."),
    ("simulate", "femfit.cli.simulate:simulate", "Close the loop: controller, filter, sensor, steps, noise, faults."),
    ("audit", "femfit.cli.audit:audit", "Check a model or a published parameter set on its own."),
    ("compare", "femfit.cli.compare:compare", "How far a model is from measurements, against their noise, and where."),
    (
        "diagnose",
        "femfit.cli.diagnose:diagnose",
        "Name the physical effect that measurements show and the model lacks.",
    ),
    ("add", "femfit.cli.add:add", "Refit a model with an effect, judged on runs that were not fitted."),
    ("suggest", "femfit.cli.suggest:suggest", "The next measurement that separates what is still confounded."),
    ("trial", "femfit.cli.trial:trial", "How often the diagnosis is right, on campaigns with a hidden effect."),
    ("integrate", "femfit.cli.integrate:integrate", "Drift-free flux or field from a coil's voltage."),
    ("bench", "femfit.cli.bench:bench", "A bench table with flux linkage from a record of a coil's voltage."),
)


def build_app() -> App:
    """The command line application.

    Returns
    -------
    App
        With every command registered by its import path, so that ``--help`` imports none of them.
    """
    app = App(
        name="femfit",
        help="From an electromagnetic actuator's drawing to a model that a filter can run.",
        version=__version__,
        suppress_keyboard_interrupt=False,  # main says that finished work is kept
    )
    for place, (name, target, text) in enumerate(COMMANDS):
        app.command(target, name=name, help=text, sort_key=place)
    return app


def main() -> None:
    """Run the command line; exit 0 done, 1 an error with its remedy, 2 usage, 130 interrupted."""
    # Before numpy loads, here and in the workers: femfit's matrices are small, and threads that wait for each other on
    # a busy machine slow them down by up to twenty times.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    app = build_app()
    try:
        app(sys.argv[1:], exit_on_error=False)
    except CycloptsError:
        sys.exit(2)  # cyclopts has printed what is wrong with the arguments
    except FemfitError as error:
        print(f"femfit: {error}", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:
        # The reader, head say, has seen enough; what is still buffered must not fail at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        print(f"femfit: {error.strerror or error}: {error.filename or ''}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("femfit: interrupted; what was finished is kept", file=sys.stderr)
        sys.exit(130)
