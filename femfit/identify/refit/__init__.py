"""A model fitted again with an effect."""
