"""What the tree is held to besides its tests: installing it, defects, hostile logs, judges."""
