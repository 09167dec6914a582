"""Hold the body for 2000 samples with filter and controller on the simulated actuator; say where it hangs."""

from pathlib import Path

import numpy as np

from femfit.core.errors import DomainError
from femfit.model.json_file import read_model
from femfit.simulation.design import design_loop
from femfit.simulation.loop import ClosedLoop, run_loop
from femfit.simulation.plant import Plant
from femfit.simulation.sensor import SensorErrors
from femfit.simulation.targets import reference_steps


def main() -> None:
    """Run the loop and print where the body hangs."""
    try:
        design = design_loop(read_model(Path(__file__).with_name("model.json")))
    except DomainError as error:  # an actuator that switches between its stops is not held in between
        print(error)
        return
    model, point = design.model, design.points[0]
    reference = reference_steps([point.distance_m], 2000, model.sample_time_s, rate=10.0)
    name = "backstepping" if "backstepping" in design.controllers else design.controllers[0]
    controller = design.controller(name)
    loop = ClosedLoop(
        Plant(model), design.loop_sensors(), SensorErrors(), design.observer("ukf"), controller, reference
    )
    start = point.state[None]
    result = run_loop(loop, start, np.random.default_rng(0))
    held = 1e3 * result.series.distance_m[1000:]
    if result.held.all():
        print(f"wanted {1e3 * point.distance_m:.3f} mm, held {held.mean():.3f} mm +- {held.std():.3f} mm")
    else:
        print(result.outcomes()[0].sentence)


if __name__ == "__main__":
    main()
