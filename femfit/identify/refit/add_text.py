"""What adding effects did, in plain sentences."""

from femfit.effects.effect import AddedEffect
from femfit.identify.readings.amounts import chance
from femfit.identify.refit.add_result import AddResult, EffectSize


def add_lines(result: AddResult) -> list[str]:
    """The result as lines of text.

    Returns
    -------
    list of str
        The effects with their sizes, the table of errors on runs left out, and what is suspicious.
    """
    lines = []
    for added in result.added:
        lines += [f"{added.effect.name}: {added.effect.symptom}", *_values(added)]
        lines += [_size(size) for size in result.sizes if size.effect == added.effect.name]
    for added in result.base:
        lines += [f"{added.effect.name} (held near zero by a prior)", *_values(added)]
    lines += ["", *_errors(result), "", *_end(result)]
    return lines


def _values(added: AddedEffect) -> list[str]:
    lines = []
    for p in added.effect.parameters:
        low, high = added.ci95.get(p.name, (None, None))
        interval = "" if low is None or high is None else f" (95 %: {low:.4g} to {high:.4g})"
        unit = f" {p.unit}" if p.unit else ""
        lines.append(f"  {p.name} = {added.parameters[p.name]:.4g}{unit}{interval}")
    return lines


def _size(size: EffectSize) -> str:
    low, high = size.ci95
    return (
        f"  changes {size.channel} by up to {size.change:.3g} (95 %: {low:.3g} to {high:.3g}), "
        f"{100 * abs(size.of_largest):.2g} % of its largest, at {1e3 * size.distance_m:.4g} mm and "
        f"{size.current_A:.3g} A"
    )


def _errors(result: AddResult) -> list[str]:
    """The table on runs left out, a row a channel and a column a step."""
    heads = [result.steps[0].text, *(f"with {step.text}" for step in result.steps[1:])]
    width = max(10, *(len(head) for head in heads))
    lines = [
        f"rms error on runs left out ({result.runs} runs, {result.readings} readings), beside each run's own re-mount:",
        f"  {'':<16}" + "".join(f"{head:>{width + 2}}" for head in heads) + f"{'noise':>12}  after/noise",
    ]
    for name in result.unseen_after:
        row = "".join(f"{step.unseen[name]:>{width + 2}.3g}" for step in result.steps)
        floor = result.floor.get(name)
        end = f"{'unknown':>12}" if floor is None else f"{floor:>12.3g}  {result.unseen_after[name] / floor:>11.2f}"
        lines.append(f"  {name:<16}{row}{end}")
    read, floors = result.as_read["after"], result.as_read["floor"]
    parts = ", ".join(f"{name} {read[name]:.3g} of {floors[name]:.3g} expected" for name in read)
    return [*lines, f"  with the re-mounts in it: {parts}"]


def _warmer(result: AddResult, name: str) -> str:
    """What was found beside a temperature that was not recorded, and counts in plant and filters too."""
    found = {
        a.effect.name: a.parameters.get("warmer_K", 0.0) + a.parameters.get("warming_K", 0.0) for a in result.added
    }
    return f" and the {found[name]:.3g} K more that were found" if found.get(name) else ""


def _end(result: AddResult) -> list[str]:
    before, after = result.gate_before, result.gate_after
    lines = [f"lack of fit, 1 expected: before {before.statistic:.2f} ({chance(before.p_value)}), after "]
    lines[0] += f"{after.statistic:.2f} ({chance(after.p_value)})"
    if not result.base:
        lines.append("The base's own amplitudes (magnet strength, turns, resistance) were not used.")
    if result.kept:
        lines.append(f"Kept as they were, since these data cannot refit them: {', '.join(result.kept)}.")
    if any(added.effect.circuit or "temperature" in " ".join(added.effect.needs) for added in result.added):
        lines.append(
            f"Plant and filters run with the coil at {result.model.coil_temperature_C:g} C"
            f"{_warmer(result, 'coil_temperature')} and the magnet at {result.model.magnet_temperature_C:g} C"
            f"{_warmer(result, 'magnet_temperature')}."
        )
    lines += [f"suspicious: {sentence}" for sentence in result.suspicious]
    return lines + [f"note: {finding}" for finding in result.findings]
