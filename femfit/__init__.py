"""femfit: from an actuator's drawing to a model that a filter can run, and to why the bench disagrees.

``import femfit`` loads none of the rooms: a name is imported from its room when it is first used. ``__init__.pyi``
beside this file lists the same names for editors and type checkers.
"""

from importlib import import_module

__version__ = "0.1.0"

PLACES = {
    # Types
    "Actuator": "femfit.device.parts:Actuator",
    "ActuatorModel": "femfit.model.actuator_model:ActuatorModel",
    "AddResult": "femfit.identify.before_after:AddResult",
    "BenchTable": "femfit.tables.measurement:BenchTable",
    "CalibrationResult": "femfit.identify.calibration.result:CalibrationResult",
    "CoilIntegral": "femfit.integrate.methods:CoilIntegral",
    "Comparison": "femfit.identify.compare:Comparison",
    "Diagnosis": "femfit.identify.decision.diagnose:Diagnosis",
    "ErrorBound": "femfit.estimate.error_bound:ErrorBound",
    "FemfitError": "femfit.core.errors:FemfitError",
    "Filter": "femfit.estimate.filter:Filter",
    "FitResult": "femfit.fit.result:FitResult",
    "ImportedTable": "femfit.tables.foreign:ImportedTable",
    "LoopSummary": "femfit.simulation.summary:LoopSummary",
    "Observation": "femfit.estimate.observe:Observation",
    "OpenLoop": "femfit.simulation.open_result:OpenLoop",
    "Profile": "femfit.simulation.profile:Profile",
    "Sensing": "femfit.simulation.sense:Sensing",
    "SweepTable": "femfit.tables.sweep_table:SweepTable",
    "Temperatures": "femfit.heat.find_temperatures:Temperatures",
    "TimeSeries": "femfit.tables.measurement:TimeSeries",
    "ToleranceAnalysis": "femfit.audit.tolerance_analysis:ToleranceAnalysis",
    # From the drawing to a model
    "read_actuator": "femfit.device.load:read_actuator",
    "run_sweep": "femfit.field.sweep:run_sweep",
    "read_sweep": "femfit.tables.sweep_table:read_sweep_table",
    "import_table": "femfit.tables.foreign:import_table",
    "fit_model": "femfit.fit.build:fit_model",
    "analyse_tolerances": "femfit.audit.tolerance_analysis:analyse_tolerances",
    "find_temperatures": "femfit.heat.find_temperatures:find_temperatures",
    "list_laws": "femfit.laws.catalogue:all_laws",
    "read_model": "femfit.model.json_file:read_model",
    "write_model": "femfit.model.json_file:write_model",
    # Motion, filters, the loop and the target
    "error_bound": "femfit.estimate.error_bound:error_bound",
    "kalman_filter": "femfit.estimate.kalman_filter:kalman_filter",
    "simulate": "femfit.simulation.open_loop:simulate",
    "sense": "femfit.simulation.sense:sense",
    "close_loop": "femfit.simulation.close_loop:close_loop",
    "export": "femfit.targets.targets:export",
    # Why the bench disagrees
    "read_measurement": "femfit.tables.measurement_file:read_measurement",
    "compare": "femfit.identify.compare:compare",
    "diagnose": "femfit.identify.decision.diagnose:diagnose",
    "suggest": "femfit.identify.suggest:suggest",
    "add_effects": "femfit.identify.add_effects:add_effects",
    "calibrate": "femfit.identify.calibration.calibrate:calibrate",
    "observe": "femfit.estimate.observe:observe",
    "list_effects": "femfit.effects.catalogue:all_effects",
    "write_report": "femfit.report.write:write_report",
    # Coil voltages
    "integrate_coil": "femfit.integrate.integrate_coil:integrate_coil",
}
"""Public name -> "module:name in it"; the one place to edit when something moves, with its line in the .pyi file."""

__all__ = ["__version__", *PLACES]  # noqa: PLE0604  all of them are strings


def __getattr__(name: str) -> object:
    place = PLACES.get(name)
    if place is None:
        raise AttributeError(f"module 'femfit' has no attribute {name!r}; it has {', '.join(sorted(PLACES))}")
    module, _, there = place.partition(":")
    value = getattr(import_module(module), there)
    if not isinstance(value, type):
        value = import_module("femfit.core.public").public(value, __name__, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
