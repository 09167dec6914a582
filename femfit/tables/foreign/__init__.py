"""Tables of other programs to sweep tables, checked."""
