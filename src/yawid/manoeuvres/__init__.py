"""Samples -> manoeuvres -> an answer each, and the flight's."""
