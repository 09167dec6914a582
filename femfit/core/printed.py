"""How a result shows itself: all of its lines where it is printed, one where it stands in something else."""

from html import escape


class Printed:
    """Shows the lines of a class's ``__str__`` in a notebook, and its name with the first of them at a prompt."""

    def __repr__(self) -> str:
        first, _, _ = str(self).partition("\n")
        return f"<{type(self).__name__}: {first}>"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"
