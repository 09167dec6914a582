"""Commented drawings to start from, one file each; ``femfit new`` copies them."""
