"""A run as tables whose columns have units, for NumPy, pandas, polars, xarray and files."""
