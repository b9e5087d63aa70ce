"""Physics: from theta to poles, modes and derivatives, each with its sigma."""
