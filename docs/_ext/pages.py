"""The pages that are made from femfit itself: actuator file, commands, library, columns, constants and effects.

They are written to ``docs/generated`` before each build, so that no page can say what femfit does not do.
"""

from pathlib import Path

import constants
import effect_pages
import library
from sphinx.application import Sphinx

import actuator_file
from femfit.cli.main import COMMANDS, build_app
from femfit.core.sweep_columns import COLUMNS

DOCS = Path(__file__).parents[1]
GENERATED = DOCS / "generated"


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the generated pages when a build begins."""
    app.connect("builder-inited", lambda _: write_pages())
    app.connect("source-read", _link_copies)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _link_copies(_app: Sphinx, _name: str, source: list[str]) -> None:
    """Link the notebooks with their results in the site where a page links those of the repository: both work."""
    source[0] = source[0].replace("](../../notebooks/", "](../tutorial/")


def write_pages() -> None:
    """Write every generated page and picture whose content has changed."""
    for name, text in _pages().items():
        path = GENERATED / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def _pages() -> dict[str, str]:
    return {
        "actuator_file.md": actuator_file.page(),
        "commands.md": _commands(),
        "library.md": library.page(),
        "columns.md": _columns(),
        "constants.md": constants.page(),
        **effect_pages.pages(),
    }


def _commands() -> str:
    """Every command with its options, as ``femfit COMMAND --help`` says them."""
    text = build_app(COMMANDS).generate_docs(output_format="markdown")
    start = text.index("## femfit run")
    end = text.index("## femfit --install-completion")
    # In Markdown a line of four blanks would become code, and a bare <...> an element
    body = "\n".join(line.strip() if line.startswith("    ") else line for line in text[start:end].splitlines())
    return _COMMANDS + body.replace("|B|", r"\|B\|") + "\n"


_COMMANDS = """\
# Commands

`femfit COMMAND --help` prints the same. [Exit codes](../reference/exit_codes.md) say how a command ended. Every command
takes `--json FILE`, which writes its result for a script. The answer stands in the first line. At most twelve
more follow, warnings first, and `--verbose` prints the rest. Files that were written are always named.
`python -m femfit` is the same as `femfit`, and `femfit --install-completion` lets the Tab key complete commands and
options in bash, zsh and fish.

"""


def _columns() -> str:
    rows = "".join(f"| `{name}` | {text} |\n" for name, text in COLUMNS.items())
    return f"| column | meaning |\n|---|---|\n{rows}"
