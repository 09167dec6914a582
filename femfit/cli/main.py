"""The ``femfit`` command: names and one-line helps; each command's file is imported when it runs."""

import os
import signal
import sys

from cyclopts import App, CycloptsError, Parameter

from femfit import __version__
from femfit.core.errors import FemfitError, UsageError

COMMANDS: tuple[tuple[str, str, str], ...] = (
    # name, target, one line of help
    ("new", "femfit.cli.new:new", "Write a commented drawing to start from: a solenoid, a voice coil, a bearing ..."),
    ("run", "femfit.cli.run:run", "Sweep, fit, export, close the loop and report, in turn."),
    ("sweep", "femfit.cli.sweep:sweep", "Solve the field over an actuator's currents and distances."),
    ("view", "femfit.cli.view:view", "Draw geometry, mesh, flux lines and |B|; write a .vtu file."),
    ("import", "femfit.cli.import_table:import_table", "Bring in a table of FEMM or another program as a sweep table."),
    ("import-fem", "femfit.cli.import_fem:import_fem", "Read a FEMM model (.fem) as an actuator file."),
    ("fit", "femfit.cli.fit:fit", "Fit a force law or a co-energy to a sweep table, and write the model file."),
    ("export", "femfit.cli.export:export", "Export a model: filters and simulator in C or in Python alone."),
    ("simulate", "femfit.cli.simulate:simulate", "Close the loop: controller, filter, sensor, steps, noise, faults."),
    ("sense", "femfit.cli.sense:sense", "How well the current tells the distance: error in simulation, and bound."),
    ("audit", "femfit.cli.audit:audit", "Check a model against its table, physics and supply; exits with 1 if wrong."),
    ("heat", "femfit.cli.heat:heat", "How warm winding and magnet become, and which current may last."),
    ("tolerance", "femfit.cli.audit:tolerance", "How a series of devices scatters by the drawing's tolerances."),
    ("observe", "femfit.cli.observe:observe", "Run a recorded log through filters: estimate, innovations, noise."),
    ("compare", "femfit.cli.compare:compare", "How far a model is from measurements, against their noise, and where."),
    ("diagnose", "femfit.cli.diagnose:diagnose", "Name the effect that measurements show and the model lacks."),
    ("add", "femfit.cli.add:add", "Refit a model with an effect, judged on runs that were not fitted."),
    ("calibrate", "femfit.cli.calibrate:calibrate", "Find a drawing's wrong numbers from measurements; write it anew."),
    ("suggest", "femfit.cli.suggest:suggest", "The next measurement that separates what is still confounded."),
    ("trial", "femfit.cli.trial:trial", "How often the diagnosis is right, on campaigns with a hidden effect."),
    ("integrate", "femfit.cli.integrate:integrate", "Drift-free flux or field from a coil's voltage."),
    ("bench", "femfit.cli.integrate:bench", "A bench table with flux linkage from a record of a coil's voltage."),
)


USAGE = 2
"""Exit code of arguments that no file makes right, as shells and most parsers have it."""

BUG = 70
"""Exit code of a failure inside femfit: EX_SOFTWARE of sysexits.h."""


class EndedError(BaseException):
    """SIGTERM: not an Exception, so that nothing on the way takes it for an error of its own."""


def build_app() -> App:
    """Register every command by its import path, so that ``--help`` imports none of them."""
    app = App(
        name="femfit",
        help="From an electromagnetic actuator's drawing to a model that a filter can run.",
        help_format="plaintext",  # markdown would take a tenth of a second to import
        version=__version__,
        # Units keep their letters; nothing is turned off by an option of its own
        default_parameter=Parameter(name_transform=lambda name: name.replace("_", "-"), negative=()),
        suppress_keyboard_interrupt=False,  # main says that finished work is kept
    )
    for place, (name, target, text) in enumerate(COMMANDS):
        app.command(target, name=name, help=text, sort_key=place)
    app.register_install_completion_command(help="Complete commands and options with the Tab key in this shell.")
    return app


def main() -> None:
    """Run the command line.

    Exit codes, as docs/reference/exit_codes.md explains them: 0 done, 1 an error with its remedy or an audit that finds
    something wrong, 2 wrong usage, 70 a bug of femfit, 130 interrupted by Ctrl-C, 143 ended by SIGTERM.
    """
    # Before numpy loads, here and in the workers: femfit's matrices are small, and threads that wait for each other on
    # a busy machine slow them down by up to twenty times.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _print_what_the_terminal_can_show()
    before = signal.signal(signal.SIGTERM, _end)
    try:  # the one place that catches errors
        try:
            build_app()(sys.argv[1:], exit_on_error=False)
        finally:
            _flush()
    except CycloptsError:
        sys.exit(USAGE)  # cyclopts has printed what is wrong with the arguments
    except UsageError as error:
        _fail(str(error), USAGE)
    except FemfitError as error:
        _fail(str(error))
    except BrokenPipeError:
        sys.exit(0)  # the reader has seen enough of what is printed, a command's help say
    except OSError as error:
        _fail(": ".join(filter(None, [error.strerror or str(error), str(error.filename or "")])))
    except MemoryError:
        _fail("the memory does not suffice. Use fewer --workers, a smaller table, or a machine with more memory.")
    except EndedError:
        _fail("ended by SIGTERM; what was finished is kept", 128 + signal.SIGTERM)
    except KeyboardInterrupt:
        _fail("interrupted; what was finished is kept", 128 + signal.SIGINT)
    except Exception as error:  # noqa: BLE001  the last net: a user is told what to do, and the traceback is kept
        _fail(_bug(error), BUG)
    finally:
        signal.signal(signal.SIGTERM, before)


def _end(*_: object) -> None:
    raise EndedError


def _flush() -> None:
    """Print what is buffered, here, where a full disk is told; a reader that has seen enough, head say, is no error."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is buffered must not fail again at exit
        if not isinstance(error, BrokenPipeError):
            raise


def _fail(text: str, code: int = 1) -> None:
    """Print an error; names from files may hold characters that would steer the terminal."""
    shown = "".join(letter if letter.isprintable() or letter in "\n\t" else "?" for letter in text)
    print(f"femfit: {shown}", file=sys.stderr)
    sys.exit(code)


def _bug(error: Exception) -> str:
    """Keep the traceback in a file, and say in one line where it is."""
    import platform
    import tempfile
    import traceback

    with tempfile.NamedTemporaryFile("w", prefix="femfit-", suffix=".log", delete=False, encoding="utf-8") as log:
        log.write(f"femfit {__version__}, Python {platform.python_version()}, {platform.platform()}\n")
        log.write(f"{sys.argv}\n\n{''.join(traceback.format_exception(error))}")
    first_line = (str(error).splitlines() or [""])[0][:200]
    return (
        f"this is a bug of femfit ({type(error).__name__}: {first_line}). Please report it with the log file "
        f"{log.name}. What was finished is kept."
    )


def _print_what_the_terminal_can_show() -> None:
    """Let a character that the terminal's encoding lacks be replaced instead of ending the command."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
