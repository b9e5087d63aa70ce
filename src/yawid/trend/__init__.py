"""What changed: a vehicle's numbers over its flights, runs and data sets against each other."""
