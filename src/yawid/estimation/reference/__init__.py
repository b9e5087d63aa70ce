"""The same recursion on filterpy's Kalman filter."""
