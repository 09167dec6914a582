"""femfit: from an actuator's drawing to a model that a filter can run, and to why the bench disagrees."""

__version__ = "0.1.0"
