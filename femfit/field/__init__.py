"""The field solver: mesh, weak form, force and flux, sweep."""
