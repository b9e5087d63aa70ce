"""A run as tables: columns with units, for NumPy, pandas, polars, xarray and files."""
