"""The configuration: what a run is asked to do."""
