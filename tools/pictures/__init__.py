"""Pictures of yawid's outputs, and the programs that draw them."""
