"""The bare airframe: the whole lateral motion fitted to p, r and roll (eq. 17-22)."""
