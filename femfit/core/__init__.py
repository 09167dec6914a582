"""Errors, arrays, tables with their units, run directories; imports nothing of femfit."""
