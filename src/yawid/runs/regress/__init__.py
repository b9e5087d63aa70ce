"""Headless regression: recorded logs replayed and compared with their references.

A case is a folder with a log (log.tlog, .bin or .ulg), case.toml (origin, licence, sha256, floor,
options, tolerances), and the references expected.csv and expected.json. Only ``update`` writes
references, and it wants a reason.
"""
