"""Physics: from theta to what a flight-test engineer asks for, each with its sigma."""
