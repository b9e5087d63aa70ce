"""Checks besides the tests: installation, seeded defects, hostile logs, judges, words."""
