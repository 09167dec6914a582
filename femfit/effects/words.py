"""Says in plain words, with units, what the fitted parameters of an effect mean."""

import re
from collections.abc import Iterable, Mapping
from math import inf

from femfit.core.numerics import first_best
from femfit.core.text import amount, amount_in, amount_range
from femfit.effects.conditions import Nominal
from femfit.effects.effect import AddedEffect, Effect, EffectParameter


def describe(added: AddedEffect, nominal: Nominal) -> list[str]:
    """What an effect is at its parameters: clauses such as ``the gap is 0.20 mm larger than recorded``.

    They have no full stop, and the 95 % interval where one was estimated; amplitudes at null are left out.
    """
    effect, values = added.effect, added.parameters
    if all(values[p.name] == p.null for p in effect.amplitudes):
        return []
    if effect.words is not None:
        return list(effect.words(values, nominal))
    spoken = [p for p in effect.parameters if p.words and (p.nonlinear or values[p.name] != p.null)]
    return [_clause(p, added, nominal) for p in spoken]


def smallest_visible(effect: Effect, magnitudes: Mapping[str, float], nominal: Nominal) -> str:
    """The smallest size of an effect that data would show, as a clause; empty where none lies within its bounds.

    Magnitudes are of each amplitude taken alone; the one that needs the least part of its plausible range is said.
    """
    parts = [(magnitudes[p.name] / p.width, p) for p in effect.amplitudes if magnitudes.get(p.name, inf) < inf]
    if not parts:
        return ""
    _, p = parts[first_best([-share for share, _ in parts])]
    size = magnitudes[p.name] if p.null + magnitudes[p.name] <= p.upper else -magnitudes[p.name]
    clauses = describe(AddedEffect(effect, effect.null() | {p.name: p.null + size}), nominal)
    return clauses[0] if clauses else ""


def size_of(p: EffectParameter, value: float, nominal: Nominal) -> str:
    """A parameter's value with its unit: of a relative one the quantity itself, ``12 mN``."""
    return amount(value * getattr(nominal, p.scale), p.scale) if p.scale else amount(value, p.unit)


def range_of(p: EffectParameter, low: float, high: float, nominal: Nominal) -> str:
    """A range of a parameter's values in one unit: ``20 to 500 ms``."""
    scale = getattr(nominal, p.scale) if p.scale else 1.0
    return amount_range(low * scale, high * scale, p.scale or p.unit)


def _clause(p: EffectParameter, added: AddedEffect, nominal: Nominal) -> str:
    value, interval = added.parameters[p.name], added.ci95.get(p.name)

    def chosen(match: re.Match[str]) -> str:
        above, _, below = match.group(1).partition("|")
        return above if value >= 0.0 else below

    if interval is None:
        size, signed, ends = size_of(p, abs(value), nominal), size_of(p, value, nominal), ""
    else:
        turned = "{signed}" not in p.words and value < 0.0
        low, high = (-interval[1], -interval[0]) if turned else interval
        scale, unit = (getattr(nominal, p.scale), p.scale) if p.scale else (1.0, p.unit)
        size, signed = (amount_in(x * scale, low * scale, high * scale, unit) for x in (abs(value), value))
        between = range_of(p, low, high, nominal)
        if not p.nonlinear and max(10.0 * abs(value - p.null), p.width) < high - low:
            return f"{p.description.rstrip('.')}: not determined (95 %: {between})"
        ends = f" (95 %: {between}{', to first order; femfit calibrate finds the size' if added.effect.title else ''})"
    clause = p.words.replace("{size}", size).replace("{signed}", signed)
    return re.sub(r"\{([^{}]*\|[^{}]*)\}", chosen, clause) + ends


def titles_of(effects: Iterable[Effect]) -> dict[str, str]:
    """What texts call effects whose names are key paths, by their names."""
    return {effect.name: effect.title for effect in effects if effect.title}


def titled(text: str, titles: Mapping[str, str]) -> str:
    """A text with titles in place of key paths; a command keeps them, and so does the line that a number heads."""
    if not titles:
        return text
    keys = "|".join(map(re.escape, sorted(titles, key=len, reverse=True)))
    command = r"femfit (?:add|calibrate) \S+\.(?:json|toml|csv)\b[^<\n]*"
    head, name = rf"^( *)({keys})(?=[:,])", rf"(?<![\w.])({keys})(?![\w\[])(?!\.[\w.])"

    def shown(match: re.Match[str]) -> str:
        if match[2]:
            return f"{match[1]}{titles[match[2]]} [{match[2]}]"
        return titles[match[3]] if match[3] else match[0]

    return re.sub(f"{command}|{head}|{name}", shown, text, flags=re.MULTILINE)
