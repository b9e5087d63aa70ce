"""Pictures of yawid's outputs, and what draws them."""
