"""Files that may hold several tables: MAT, XLSX, HDF5, TDMS and WAV, each read to its named tables."""
