"""Open loop: a profile of voltage or current in, motion and switching out."""
