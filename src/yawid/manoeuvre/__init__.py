"""A manoeuvre on its way from the samples to its answer: found, fitted, judged, pooled."""
