"""The numbers of a drawing found from bench data."""
