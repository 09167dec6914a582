"""What runs a model without femfit: a file of Python, C for a microcontroller."""
