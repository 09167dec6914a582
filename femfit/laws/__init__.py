"""Force laws: one small file each, listed in one tuple."""
