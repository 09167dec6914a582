"""The names of ``femfit`` for editors and type checkers; ``__init__.py`` loads them when they are used."""

from femfit.audit.tolerance_analysis import ToleranceAnalysis as ToleranceAnalysis
from femfit.audit.tolerance_analysis import analyse_tolerances as analyse_tolerances
from femfit.core.errors import FemfitError as FemfitError
from femfit.device.load import read_actuator as read_actuator
from femfit.device.parts import Actuator as Actuator
from femfit.effects.catalogue import all_effects as list_effects
from femfit.estimate.error_bound import ErrorBound as ErrorBound
from femfit.estimate.error_bound import error_bound as error_bound
from femfit.estimate.filter import Filter as Filter
from femfit.estimate.kalman_filter import kalman_filter as kalman_filter
from femfit.estimate.observe import Observation as Observation
from femfit.estimate.observe import observe as observe
from femfit.field.sweep import run_sweep as run_sweep
from femfit.fit.build import fit_model as fit_model
from femfit.fit.result import FitResult as FitResult
from femfit.heat.find_temperatures import Temperatures as Temperatures
from femfit.heat.find_temperatures import find_temperatures as find_temperatures
from femfit.identify.add_effects import add_effects as add_effects
from femfit.identify.before_after import AddResult as AddResult
from femfit.identify.calibration.calibrate import calibrate as calibrate
from femfit.identify.calibration.result import CalibrationResult as CalibrationResult
from femfit.identify.compare import Comparison as Comparison
from femfit.identify.compare import compare as compare
from femfit.identify.decision.diagnose import Diagnosis as Diagnosis
from femfit.identify.decision.diagnose import diagnose as diagnose
from femfit.identify.suggest import suggest as suggest
from femfit.integrate.integrate_coil import integrate_coil as integrate_coil
from femfit.integrate.methods import CoilIntegral as CoilIntegral
from femfit.laws.catalogue import all_laws as list_laws
from femfit.model.actuator_model import ActuatorModel as ActuatorModel
from femfit.model.json_file import read_model as read_model
from femfit.model.json_file import write_model as write_model
from femfit.report.write import write_report as write_report
from femfit.simulation.close_loop import close_loop as close_loop
from femfit.simulation.open_loop import simulate as simulate
from femfit.simulation.open_result import OpenLoop as OpenLoop
from femfit.simulation.profile import Profile as Profile
from femfit.simulation.sense import Sensing as Sensing
from femfit.simulation.sense import sense as sense
from femfit.simulation.summary import LoopSummary as LoopSummary
from femfit.tables.foreign import ImportedTable as ImportedTable
from femfit.tables.foreign import import_table as import_table
from femfit.tables.measurement import BenchTable as BenchTable
from femfit.tables.measurement import TimeSeries as TimeSeries
from femfit.tables.measurement_file import read_measurement as read_measurement
from femfit.tables.sweep_table import SweepTable as SweepTable
from femfit.tables.sweep_table import read_sweep_table as read_sweep
from femfit.targets.targets import export as export

__all__ = [
    "Actuator",
    "ActuatorModel",
    "AddResult",
    "BenchTable",
    "CalibrationResult",
    "CoilIntegral",
    "Comparison",
    "Diagnosis",
    "ErrorBound",
    "FemfitError",
    "Filter",
    "FitResult",
    "ImportedTable",
    "LoopSummary",
    "Observation",
    "OpenLoop",
    "Profile",
    "Sensing",
    "SweepTable",
    "Temperatures",
    "TimeSeries",
    "add_effects",
    "calibrate",
    "close_loop",
    "compare",
    "diagnose",
    "error_bound",
    "export",
    "find_temperatures",
    "fit_model",
    "import_table",
    "integrate_coil",
    "kalman_filter",
    "list_effects",
    "list_laws",
    "observe",
    "read_actuator",
    "read_measurement",
    "read_model",
    "read_sweep",
    "run_sweep",
    "sense",
    "simulate",
    "suggest",
    "write_model",
    "write_report",
]

__version__: str
PLACES: dict[str, str]
