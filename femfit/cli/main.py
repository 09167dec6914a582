"""The ``femfit`` command; each command's file is imported when it runs."""

import os
import signal
import sys
from collections.abc import Collection
from pathlib import Path

from cyclopts import App, CycloptsError, Parameter

from femfit import __version__
from femfit.core.errors import FemfitError, UsageError

COMMANDS = {
    "new": "drawings:new",
    "run": "run:run",
    "sweep": "sweeps:sweep",
    "view": "drawings:view",
    "import": "sweeps:import_table",
    "import-fem": "drawings:import_fem",
    "fit": "sweeps:fit",
    "export": "models:export",
    "simulate": "models:simulate",
    "sense": "models:sense",
    "audit": "models:audit",
    "heat": "drawings:heat",
    "tolerance": "models:tolerance",
    "observe": "records:observe",
    "compare": "benches:compare",
    "diagnose": "benches:diagnose",
    "add": "benches:add",
    "calibrate": "benches:calibrate",
    "suggest": "benches:suggest",
    "trial": "benches:trial",
    "integrate": "records:integrate",
    "bench": "records:bench",
}
"""Names of the commands in the order of ``--help``: file of this folder and function."""


USAGE = 2
"""Exit code of arguments that no file makes right, as shells and most parsers have it."""

BUG = 70
"""Exit code of a failure inside femfit: EX_SOFTWARE of sysexits.h."""


class EndedError(BaseException):
    """SIGTERM: not an Exception, so that nothing on the way takes it for an error of its own."""


def build_app(described: Collection[str]) -> App:
    """Register every command by its import path, so that ``--help`` imports none of them.

    Those that are described say all of their docstring, the others its first line.
    """
    app = App(
        name="femfit",
        help="From an electromagnetic actuator's drawing to a model that a filter can run.",
        help_format="plaintext",  # markdown would take a tenth of a second to import
        version=__version__,
        # Units keep their letters; nothing is turned off by an option of its own
        default_parameter=Parameter(name_transform=lambda name: name.replace("_", "-"), negative=()),
        suppress_keyboard_interrupt=False,  # main says that finished work is kept
    )
    for place, (name, target) in enumerate(COMMANDS.items()):
        file, _, function = target.partition(":")
        text = Path(__file__).with_name(f"{file}.py").read_text(encoding="utf-8")  # to import it would take a second
        _, _, docstring = text.partition(f"\ndef {function}(")[2].partition('"""')
        first_line = None if name in described else docstring.splitlines()[0].removesuffix('"""')
        app.command(f"femfit.cli.{target}", name=name, help=first_line, sort_key=place)
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
            build_app(sys.argv[1:2])(sys.argv[1:], exit_on_error=False)
        finally:
            _flush()
    except CycloptsError:
        sys.exit(USAGE)  # cyclopts has printed what is wrong with the arguments
    except UsageError as error:
        _fail(str(error), USAGE)
    except FemfitError as error:
        _fail(str(error))
    except (BrokenPipeError, SystemExit) as error:
        # The reader has seen enough of what is printed; where that is a command's help, rich makes an exit of it
        sys.exit(0 if BrokenPipeError in (type(error), type(error.__context__)) else getattr(error, "code", 0))
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
        versions = f"femfit {__version__}, Python {platform.python_version()}, {platform.platform()}"
        log.write(f"{versions}\n{sys.argv}\n\n{''.join(traceback.format_exception(error))}")
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
