"""Options of a command that are keywords of a function of the library: declared there, once, with their text.

The function's docstring says type and text of each, its signature the default. Both are read from its file: to load the
function would take a second, for which nobody waits who asks for ``--help``.
"""

import ast
import inspect
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from femfit.core.errors import UsageError

_SECTION = re.compile(r"^(?:Parameters|Attributes)\n-+\n(.*?)(?=^\w+\n-+$|\Z)", re.MULTILINE | re.DOTALL)
_ENTRY = re.compile(r"^(\w.*?) : (.*)\n((?: .*\n?|\n)*)", re.MULTILINE)
_BOUNDS = re.compile(r"(>=?) (\S+?)(?: and <= (\S+))?(?=,| or |$)")
_MAPPING, _NAMES = re.compile(r"mapping of str to (float or str|float|str|\(float, float\))"), "sequence of str"
_PREFIXED = {"mm": ("m", 1e-3), "um": ("m", 1e-6), "ms": ("s", 1e-3), "uV": ("V", 1e-6), "g": ("kg", 1e-3)}


@dataclass(frozen=True)
class Keyword:
    """One keyword, its name as an option, and what the library says of it.

    Attributes
    ----------
    kind : str
        Type in the docstring's words: ``float > 0 or None``, ``{'held', 'linear'}``, ``mapping of str to float``.
    """

    name: str
    option: str
    kind: str
    text: str
    default: Any

    @property
    def type(self) -> Any:
        """What the command line is asked for."""
        if self.kind.startswith("{"):
            return Literal[ast.literal_eval(f"({self.kind[1 : self.kind.index('}')]},)")]
        kinds: dict[str, Any] = {"Path": Path, "mapping": tuple[str, ...], _NAMES: tuple[str, ...]}
        kinds |= {"(float, float)": str, "sequence of float": tuple[float, ...], "sequence of int": tuple[int, ...]}
        kinds |= {"int": int, "float": float, "bool": bool}
        return next((kind for word, kind in kinds.items() if word in self.kind), str)

    @property
    def parameter(self) -> inspect.Parameter:
        """The option, for the parser: not given by default, whereby the function's own default counts."""
        bounds = _BOUNDS.search(self.kind)
        limits: dict[str, float] = {}
        if bounds:
            limits = {"gt" if bounds[1] == ">" else "gte": float(bounds[2])}
            limits |= {"lte": float(bounds[3])} if bounds[3] else {}
        several, flag = getattr(self.type, "__origin__", None) is tuple, self.type is bool
        default = ",".join(self.default) if isinstance(self.default, tuple) else self.default
        text = self.text + (" May be repeated." if several else "")
        text += f" [default: {default}]" if default not in {None, ""} and not flag else ""
        validator = Number(**limits) if limits else None
        shown = Parameter(name=f"--{self.option}", help=text, validator=validator, show_default=flag)
        kind, unset = (self.type, () if several else False) if several or flag else (self.type | None, None)
        option = inspect.Parameter(f"option_{self.name}", inspect.Parameter.KEYWORD_ONLY, default=unset)
        return option.replace(annotation=Annotated[kind, shown])

    def value(self, given: Any) -> Any:
        """What was given, as the function takes it: in SI, names one by one, values by their names."""
        base, factor = _PREFIXED.get(self.option.rpartition("-")[2], ("", 1.0))
        if base and self.name.endswith(f"_{base}"):
            return factor * given
        if values := _MAPPING.search(self.kind):
            return self._by_name(given, values[1])
        if _NAMES in self.kind:
            return names_of(given)
        return self._parsed(given, "LOW:HIGH", limits_of) if "(float, float)" in self.kind else given

    def _by_name(self, texts: Iterable[str], values: str) -> Any:
        """Values by their names, or one number where the function takes that too."""
        form, value_of = _VALUES[values]
        texts = names_of(texts) if values == "float" else tuple(texts)
        if self.kind.startswith("float") and len(texts) == 1 and "=" not in texts[0]:
            return self._parsed(texts[0], "NUMBER", float)

        def pair(text: str) -> tuple[str, Any]:
            name, _, value = (part.strip() for part in text.rpartition("="))
            if not (name and value):
                raise ValueError(text)
            return name, value_of(value)

        return dict(self._parsed(text, f"NAME={form}", pair) for text in texts)

    def _parsed(self, text: str, form: str, value_of: Callable[[str], Any]) -> Any:
        try:
            return value_of(text)
        except ValueError as error:
            raise UsageError(
                f"--{self.option} must read {form}; instead received {text!r}. It is: {self.text}"
            ) from error


@dataclass(frozen=True)
class Keywords:
    """Marks a parameter of a command that gets the keywords that were given, by their names.

    Attributes
    ----------
    place : str
        ``module:name`` of the function, or of the dataclass whose fields they are.
    names : str
        Which of its keywords, in the order of ``--help``; ``duration_s=duration-ms`` where the option has another name.
    """

    place: str
    names: str

    @cached_property
    def entries(self) -> tuple[Keyword, ...]:
        """The keywords with what the library says of them."""
        module, _, name = self.place.partition(":")
        spec = find_spec(module)
        assert spec is not None  # noqa: S101  the tests load every command
        assert spec.origin is not None  # noqa: S101
        body = ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body
        node: Any = next(node for node in body if getattr(node, "name", "") == name)
        section = _SECTION.search(ast.get_docstring(node) or "")
        said = {
            keyword: (kind, " ".join(text.split()))
            for names, kind, text in _ENTRY.findall(section[1] if section else "")
            for keyword in names.split(", ")
        }
        options = {keyword: option or keyword for keyword, _, option in (w.partition("=") for w in self.names.split())}
        options = {keyword: option.replace("_", "-") for keyword, option in options.items()}
        defaults = _defaults(node)
        return tuple(
            Keyword(keyword, option, said[keyword][0], _as_options(said[keyword][1], options), defaults.get(keyword))
            for keyword, option in options.items()
        )

    def taken(self, options: dict[str, Any]) -> dict[str, Any]:
        """What was given of them, taken out of a command's options."""
        given = {entry: options.pop(f"option_{entry.name}", None) for entry in self.entries}
        return {e.name: e.value(value) for e, value in given.items() if value is not None and value not in ((), False)}


def _defaults(node: Any) -> dict[str, Any]:
    """Of a function's keywords, or of a class's fields."""
    if isinstance(node, ast.ClassDef):
        fields = (field for field in node.body if isinstance(field, ast.AnnAssign))
        pairs = [(ast.unparse(field.target), field.value) for field in fields]
    else:
        pairs = [(each.arg, value) for each, value in zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True)]
    return {name: ast.literal_eval(value) for name, value in pairs if isinstance(value, ast.Constant | ast.Tuple)}


def _as_options(text: str, options: Mapping[str, str]) -> str:
    """A docstring's text for the command line: ``{"Kraft": "gf"}`` is Kraft=gf there, a keyword's name its option."""

    def written(code: re.Match[str]) -> str:
        value = re.sub(r"[{}\"]|(?<=[:,]) ", "", code[1].replace('": ', "="))
        return f"--{options[value]}" if value in options else re.sub(r"\((.*?),(.*?)\)", r"\1:\2", value)

    return re.sub(r"``(.*?)``", written, text)


def names_of(texts: str | Iterable[str] | None) -> tuple[str, ...]:
    """Names, with commas between them or one by one."""
    texts = [texts] if isinstance(texts, str) else texts or ()
    return tuple(name for text in texts for part in text.split(",") if (name := part.strip()))


def limits_of(text: str) -> tuple[float, float]:
    """LOW:HIGH, either of which may be empty."""
    low, colon, high = text.partition(":")
    limits = (float(low or -math.inf), float(high or math.inf))
    if not (colon and limits[0] <= limits[1]):
        raise ValueError(text)
    return limits


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


_VALUES: Mapping[str, tuple[str, Callable[[str], Any]]] = {
    "float": ("NUMBER", float),
    "str": ("VALUE", str),
    "float or str": ("VALUE", _number_or_text),
    "(float, float)": ("LOW:HIGH", limits_of),
}
"""How the values of a mapping are written, by the words of the docstring, and read."""
