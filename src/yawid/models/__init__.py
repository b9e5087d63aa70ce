"""The identified models of a run: fitted again with their covariance, and handed to other tools."""
