"""A recorded log through a filter: estimate, innovations, and the noise that the log shows."""
