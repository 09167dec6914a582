"""The study of the diagnosis on the project's own drawings: baselines, records over time, and what is asked for."""
