"""The manoeuvres of a flight: found in its samples, answered one by one and all together."""
