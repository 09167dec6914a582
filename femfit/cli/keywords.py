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

from femfit import PLACES
from femfit.core.errors import UsageError

_SECTION = re.compile(r"^(?:Parameters|Attributes)\n-+\n(.*?)(?=^\w+\n-+$|\Z)", re.MULTILINE | re.DOTALL)
_ENTRY = re.compile(r"^(\w.*?) : (.*)\n((?: .*\n?|\n)*)", re.MULTILINE)
_CHOICES, _BOUNDS = re.compile(r"\{(.*)\}"), re.compile(r"(>=?) (\S+?)(?: and <= (\S+))?(?=,| or |$)")
_PREFIXED = {"mm": ("m", 1e-3), "um": ("m", 1e-6), "ms": ("s", 1e-3), "uV": ("V", 1e-6), "g": ("kg", 1e-3)}


def limits_of(text: str) -> tuple[float, float]:
    """LOW:HIGH, either of which may be empty."""
    low, colon, high = text.partition(":")
    limits = (float(low or -math.inf), float(high or math.inf))
    if not (colon and limits[0] <= limits[1]):
        raise ValueError(text)
    return limits


def number_or_text(text: str) -> float | str:
    """A number where it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def names_of(texts: Iterable[str]) -> tuple[str, ...]:
    """Names, with commas between them or one by one."""
    return tuple(name for text in texts for word in text.split(",") if (name := word.strip()))


def finite(text: str | float) -> float:
    """A number that is neither infinite nor NaN."""
    if not math.isfinite(float(text)):
        raise ValueError(text)
    return float(text)


_Read = Callable[[Any], Any]
_MAPPINGS: Mapping[str, tuple[str, _Read]] = {
    "mapping of str to (float, float)": ("LOW:HIGH", limits_of),
    "mapping of str to float or str": ("VALUE", number_or_text),
    "mapping of str to float": ("NUMBER", finite),
    "mapping of str to str": ("VALUE", str),
}
"""Words of a docstring for values by their names: how a value is written, and read."""

_NAMES, _LIMITS = "sequence of str", "(float, float)"

_TYPES: Mapping[str, Any] = {
    **dict.fromkeys((*_MAPPINGS, _NAMES), tuple[str, ...]),
    "sequence of float": tuple[float, ...],
    "sequence of int": tuple[int, ...],
    _LIMITS: str,
    "Path": Path,
    "int": int,
    "float": float,
    "bool": bool,
    "": str,
}
"""Words of a docstring, the first of which that a type has counts, and what the command line is asked for."""


@dataclass(frozen=True)
class Keyword:
    """One keyword, its name as an option, and what the library says of it.

    Attributes
    ----------
    declared : str
        Type in the docstring's words: ``float > 0 or None``, ``{'held', 'linear'}``, ``mapping of str to float``.
    words : str
        Those of :data:`_TYPES` that are in it.
    """

    name: str
    option: str
    declared: str
    words: str
    text: str
    default: Any

    @property
    def parameter(self) -> inspect.Parameter:
        """The option, for the parser: not given by default, whereby the function's own default counts."""
        asked, bounds, choices = _TYPES[self.words], _BOUNDS.search(self.declared), _CHOICES.match(self.declared)
        several, flag = getattr(asked, "__origin__", None) is tuple, asked is bool
        unit = self.value(1.0) if self.words == "float" else 1.0  # limits and default are said in SI
        text = self.text + (" May be repeated." if several else "")
        if self.default is not None and self.default != () and not flag:
            usual = float(f"{self.default / unit:g}") if self.words == "float" else self.default
            text += f" [default: {','.join(usual) if isinstance(usual, tuple) else usual}]"
        texts = {"gt" if bounds[1] == ">" else "gte": bounds[2], "lte": bounds[3]} if bounds else {}
        limits = {name: ast.literal_eval(limit) for name, limit in texts.items() if limit}
        limits = {name: limit if unit == 1.0 else limit / unit for name, limit in limits.items()}
        shown = Parameter(
            name=f"--{self.option}", help=text, validator=Number(**limits) if limits else None, show_default=flag
        )
        if choices:
            asked = Literal[ast.literal_eval(f"({choices[1]},)")]
        option = inspect.Parameter(f"option_{self.name}", inspect.Parameter.KEYWORD_ONLY)
        unset = () if several else False if flag else None
        return option.replace(default=unset, annotation=Annotated[asked if several or flag else asked | None, shown])

    def value(self, argument: Any) -> Any:
        """What was given, as the function takes it: in SI, names one by one, values by their names."""
        if self.words in {"float", "sequence of float"}:
            for number in argument if isinstance(argument, tuple) else (argument,):
                self._read(number, "NUMBER", finite)
        base, factor = _PREFIXED.get(self.option.rpartition("-")[2], ("", 1.0))
        if base and self.name.endswith(f"_{base}"):
            return factor * argument
        if self.words in _MAPPINGS:
            return self._by_name(argument, *_MAPPINGS[self.words])
        if self.words == _NAMES:
            return names_of(argument) or argument
        return self._read(argument, "LOW:HIGH", limits_of) if self.words == _LIMITS else argument

    def _by_name(self, texts: tuple[str, ...], form: str, read: _Read) -> Any:
        """Values by their names, or one number where the function takes that too."""
        texts = names_of(texts) or texts if read is finite else texts
        if self.declared.startswith("float") and len(texts) == 1 and "=" not in texts[0]:
            return self._read(texts[0], form, read)

        def pair(text: str) -> tuple[str, Any]:
            name, _, value = (word.strip() for word in text.rpartition("="))
            if not (name and value):
                raise ValueError(text)
            return name, read(value)

        return dict(self._read(text, f"NAME={form}", pair) for text in texts)

    def _read(self, text: Any, form: str, read: _Read) -> Any:
        try:
            return read(text)
        except ValueError as error:
            problem = f"--{self.option} must read {form}; instead received {str(text)!r}. It is: {self.text}"
            raise UsageError(problem) from error


@dataclass(frozen=True)
class Keywords:
    """Marks a parameter of a command that gets the keywords that were given, by their names.

    Attributes
    ----------
    function : str
        Public name of the function, or ``module:name`` of another one, or of the dataclass whose fields they are.
    names : str
        Which of its keywords, in the order of ``--help``; ``duration_s=duration-ms`` where the option has another name.
    """

    function: str
    names: str

    @cached_property
    def entries(self) -> tuple[Keyword, ...]:
        """The keywords with what the library says of them."""
        module, _, name = PLACES.get(self.function, self.function).partition(":")
        spec = find_spec(module)
        assert spec is not None  # noqa: S101  the tests load every command
        assert spec.origin is not None  # noqa: S101
        body = ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body
        node: Any = next(node for node in body if getattr(node, "name", "") == name)
        section = _SECTION.search(ast.get_docstring(node) or "")
        pairs = (name.partition("=") for name in self.names.split())
        options = {keyword: (option or keyword).replace("_", "-") for keyword, _, option in pairs}
        documented = {
            keyword: (declared, next(words for words in _TYPES if words in declared), _as_options(text, options))
            for names, declared, text in _ENTRY.findall(section[1] if section else "")
            for keyword in names.split(", ")
        }
        defaults = _defaults(node)
        return tuple(
            Keyword(keyword, option, *documented[keyword], defaults.get(keyword)) for keyword, option in options.items()
        )

    def arguments(self, options: dict[str, Any]) -> dict[str, Any]:
        """The function's arguments that were given, taken out of a command's options."""
        values = {entry: options.pop(f"option_{entry.name}", None) for entry in self.entries}
        return {
            entry.name: entry.value(value)
            for entry, value in values.items()
            if value is not None and value is not False and value != ()
        }


def _defaults(node: Any) -> dict[str, Any]:
    """Of a function's keywords, or of a class's fields."""
    if isinstance(node, ast.ClassDef):
        fields = (field for field in node.body if isinstance(field, ast.AnnAssign))
        pairs = [(ast.unparse(field.target), field.value) for field in fields]
    else:
        arguments = [argument.arg for argument in node.args.kwonlyargs]
        pairs = list(zip(arguments, node.args.kw_defaults, strict=True))
    return {name: ast.literal_eval(value) for name, value in pairs if isinstance(value, ast.Constant | ast.Tuple)}


def _as_options(text: str, options: Mapping[str, str]) -> str:
    """A docstring's text for the command line: ``{"Kraft": "gf"}`` is Kraft=gf there, a keyword's name its option."""

    def written(code: re.Match[str]) -> str:
        value = re.sub(r"[{}\"]|(?<=[:,]) ", "", code[1].replace('": ', "="))
        return f"--{options[value]}" if value in options else re.sub(r"\((.*?),(.*?)\)", r"\1:\2", value)

    return re.sub(r"``(.*?)``", written, " ".join(text.split()))
