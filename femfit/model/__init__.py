"""The actuator model: co-energy or law, circuit, motion, sensor; JSON in and out. numpy only."""
