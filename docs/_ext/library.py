"""The page of the library: every public name of ``femfit``."""

import inspect

import femfit

GROUPS = {
    "From the drawing to a model": (
        "read_actuator find_temperatures run_sweep analyse_tolerances read_sweep import_table fit_model list_laws "
        "read_model write_model"
    ),
    "Filters, the loop and the target": "error_bound sense kalman_filter close_loop simulate export",
    "Why the bench disagrees": (
        "read_measurement observe compare diagnose suggest add_effects calibrate list_effects write_report"
    ),
    "Coil voltages": "integrate_coil",
}


def page() -> str:
    """The whole page."""
    names = [name for name in femfit.__all__ if not name.startswith("_")]
    known = [name for group in GROUPS.values() for name in group.split()]
    types = [name for name in names if inspect.isclass(getattr(femfit, name))]
    missing = set(names) - set(known) - set(types)
    if missing:
        raise ValueError(f"docs/_ext/library.py must put {sorted(missing)} into a group")
    sections = [
        _section(title, [name for name in group.split() if name in names], "autofunction")
        for title, group in GROUPS.items()
    ]
    return _HEAD + "".join(sections) + _section("Types", types, "autoclass")


def _section(title: str, names: list[str], directive: str) -> str:
    options = ":members:\n" if directive == "autoclass" else ""
    blocks = "".join(
        f"```{{eval-rst}}\n.. {directive}:: femfit.{name}\n{'   ' + options if options else ''}```\n\n"
        for name in names
    )
    return f"## {title}\n\n{blocks}" if names else ""


_HEAD = """\
# The library

```python
import femfit as ff
```

These names are all that femfit promises. `import femfit` is quick: a name loads its part of femfit when it is first
used. Files are given as `str` or `Path`, options are keywords, and randomness is `rng` (a seed or a numpy generator).
Each result prints the lines that the command prints with `--verbose`, and shows itself in a notebook; where the command
writes `--json`, `result.to_dict()` holds what is in that file of the result. Scripts need no `__main__` guard.

femfit's matrices are small, and threads inside of them only wait for each other on a busy machine. While one of these
functions works, the process has one thread for linear algebra, and your setting again after it.

Every error that femfit raises on purpose is a `FemfitError`, and also the builtin error of its kind.

## Figures

`result.plot()` draws the figure that says most of a result, as its page or its picture file has it, and
`result.plot(NAME)` another one; it is a matplotlib `Figure`, which a notebook shows and `savefig` writes. What a figure
needs is worked out when it is asked for: the field of a drawing is solved for those that `femfit view` draws alone.

| what made the result | names of its figures |
|---|---|
| `read_actuator` | `actuator`, `geometry`, `mesh`, `flux-lines`, `flux-density` |
| `run_sweep`, `read_sweep`, `import_table` | `force-curves`; where the table holds its drawing, those of the drawing |
| `fit_model`, `read_model` | `stroke`, `force-curves`, `hall`; of several circuits `force-curves`, `circuits` |
| `simulate` | `motion` |
| `close_loop` | `steps-` and the controller |
| `sense`, `observe` | `sensing`, `replay` |
| `compare`, `diagnose` | `curves-` and each channel, the worst first, `misfit-maps`, `misfit-covariates` |
| `add_effects` | `curves-` and each channel, before and after |

"""
