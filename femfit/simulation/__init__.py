"""Plant, Hall sensor, controllers, closed loop. numpy only."""
