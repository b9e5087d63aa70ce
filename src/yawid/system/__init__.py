"""What Windows and macOS lack or do differently: all other files ask here, and run on all three."""
