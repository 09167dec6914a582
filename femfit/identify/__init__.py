"""Where a model fails against measurements, which effect is missing, and what to measure next."""
