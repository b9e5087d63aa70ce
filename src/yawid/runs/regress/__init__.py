"""Regression tests: recorded logs are replayed and compared with their references.

A case is a folder with a log (log.tlog, .bin or .ulg), case.toml (origin, licence, sha256, floor,
options, tolerances, updates), and the references expected.csv and expected.json. Only ``update``
writes references, and it requires a reason.
"""
